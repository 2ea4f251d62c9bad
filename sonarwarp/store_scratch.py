"""Folders in which logs are made, beside their place: claimed by a living writer, swept once it is dead.

A log that will be NAME is made in ``.NAME.HEX``; one that it replaces waits as ``.NAME.HEX.old`` until the new one is
in its place.
"""

from __future__ import annotations

import os
import re
import shutil
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sonarwarp.durable import claim


@contextmanager
def scratch_folder(path: Path) -> Iterator[Path]:
    """A new folder beside ``path``, claimed by this process; what is left of it when the context ends is removed."""
    scratch = path.with_name(f".{path.name}.{uuid.uuid4().hex}")
    # Claimed before it has the name that others look for.
    unclaimed = scratch.with_name(f"{scratch.name}.new")
    unclaimed.mkdir()
    handle = claim(unclaimed)
    try:
        os.rename(unclaimed, scratch)
        yield scratch
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
        if handle is not None:
            os.close(handle)


def put_in_place(scratch: Path, path: Path) -> None:
    """Give a log its name, and remove an older one of that name."""
    if not os.path.lexists(path):
        os.rename(scratch, path)
        return
    old = _old_of(scratch)
    os.rename(path, old)
    os.rename(scratch, path)
    shutil.rmtree(old, ignore_errors=True)


def sweep(path: Path) -> None:
    """Remove what writers of a log at ``path`` left that were killed as they made it, and no living one's.

    A log that was about to be replaced goes back to its place.
    """
    ours = re.compile(re.escape(f".{path.name}.") + r"([0-9a-f]{32})(\.old)?")
    try:
        found = [match for entry in os.scandir(path.parent) if (match := ours.fullmatch(entry.name))]
    except OSError:
        return  # no folder, or none that may be read: making the log says so
    for number in {match[1] for match in found}:
        _sweep_one(path.with_name(f".{path.name}.{number}"), path)


def _sweep_one(scratch: Path, path: Path) -> None:
    old = _old_of(scratch)
    if not scratch.exists():
        # The new log had come to its place.
        shutil.rmtree(old, ignore_errors=True)
        return
    with suppress(OSError):
        handle = claim(scratch)
        if handle is None:
            return
        try:
            if old.exists() and not os.path.lexists(path):
                os.rename(old, path)
            shutil.rmtree(scratch, ignore_errors=True)
            shutil.rmtree(old, ignore_errors=True)
        finally:
            os.close(handle)


def _old_of(scratch: Path) -> Path:
    return scratch.with_name(f"{scratch.name}.old")
