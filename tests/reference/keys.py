"""Integer oracle of the key hash."""

_MASK = 2**64 - 1


def mix_key(key: int, value: int) -> int:
    """SplitMix64 finaliser of ``key`` advanced by ``value + 1`` golden steps."""
    x = (key + 0x9E3779B97F4A7C15 * ((value & 0xFFFFFFFF) + 1)) & _MASK
    x = ((x ^ (x >> 30)) * 0xBF58476D1CE4E5B9) & _MASK
    x = ((x ^ (x >> 27)) * 0x94D049BB133111EB) & _MASK
    return x ^ (x >> 31)
