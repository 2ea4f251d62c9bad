"""What the commands that print Markdown share: the table itself, and the file for machines beside it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sonarwarp.app.machine import find_device


def markdown(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table, every cell as it stands."""
    lines = (headings, ("---",) * len(headings), *rows)
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def prepare(json_file: Path | None, device: str | None) -> str:
    """The Warp device of a name, Warp's choice where there is none, once it and the file are known to serve.

    Before the work, not after.

    Raises:
        SystemExit: no such device, or a file that cannot be written to; one line that says so.
    """
    try:
        if json_file is not None:
            with json_file.open("a"):
                pass
        return find_device(device)
    except OSError as error:
        raise SystemExit(f"json: cannot write to {json_file}: {error.strerror}") from None
    except ValueError as error:
        raise SystemExit(str(error)) from None


def write_json(json_file: Path | None, rows: Sequence[Mapping[str, Any]]) -> None:
    """Rows as JSON, where there is a file for them."""
    if json_file is not None:
        json_file.write_text(json.dumps(rows, indent=2, allow_nan=False) + "\n")
