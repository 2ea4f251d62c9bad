"""Calls that may be refused: what they give, or what they say."""

from collections.abc import Callable
from typing import Any


def attempt(call: Callable[..., Any], *arguments: Any) -> tuple[Any, str | None]:
    """What a call gives and None, or None and the message of its ``ValueError``, which must be one line.

    Any other exception is a failure of the test, as is a message of several lines.
    """
    try:
        return call(*arguments), None
    except ValueError as refusal:
        message = str(refusal)
    assert message.strip()
    assert len(message.splitlines()) == 1, message
    return None, message
