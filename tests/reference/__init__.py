"""NumPy float64 oracles of the kernels; never shipped."""
