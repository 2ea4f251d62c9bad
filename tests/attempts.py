"""Inputs that may be refused: what comes of them, and how many were tried."""

import os
from collections import Counter
from collections.abc import Callable
from typing import Any

tried: Counter[str] = Counter()
"""Inputs tried so far, by test file."""


def count_inputs(number: int = 1) -> None:
    """Count inputs that a test has made up and handed over, towards the total that ends a run of the tests."""
    tried[os.environ["PYTEST_CURRENT_TEST"].partition("::")[0]] += number


def attempt(call: Callable[..., Any], *arguments: Any) -> tuple[Any, str | None]:
    """What a call gives and None, or None and the message of its ``ValueError``, which must be one line.

    Any other exception is a failure of the test, as is a message of several lines. Counts as one input.
    """
    count_inputs()
    try:
        return call(*arguments), None
    except ValueError as refusal:
        message = str(refusal)
    assert message.strip()
    assert len(message.splitlines()) == 1, message
    return None, message
