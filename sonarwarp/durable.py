"""Files that are whole whenever a program or a machine stops."""

from __future__ import annotations

import os
from pathlib import Path


def settle(folder: Path) -> None:
    """Wait until the files below ``folder`` and the folders around them are on the disk, not just in its cache."""
    if os.name == "posix":
        for path in (*folder.rglob("*"), folder, folder.parent):
            handle = os.open(path, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


def replace_text(path: Path, text: str) -> None:
    """Write a file so that whoever reads it finds the old or the new one, whole."""
    partial = path.with_name(f"{path.name}.partial")
    try:
        with partial.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
