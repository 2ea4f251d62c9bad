"""Files that are whole whenever a program or a machine stops."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO


def settle(folder: Path) -> None:
    """Wait until the files below ``folder`` and the folders around them are on the disk, not just in its cache."""
    if os.name == "posix":
        # A draft may be gone by now, as where an interrupted write goes on in zarr's own thread.
        files = (path for path in folder.rglob("*") if path.suffix != ".partial")
        for path in (*files, folder, folder.parent):
            handle = os.open(path, os.O_RDONLY)
            try:
                os.fsync(handle)
            finally:
                os.close(handle)


@contextmanager
def replacing(path: Path) -> Iterator[IO[bytes]]:
    """A file to write in the place of ``path``: whoever reads there finds the old or the new one, whole.

    The new one takes the place as the context ends; where an exception ends it, the old one stays.

    Raises:
        OSError: the folder does not exist or may not be written, or the disk is full; it names ``path``.
    """
    partial = path.with_name(f"{path.name}.partial")
    try:
        with partial.open("wb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        # A folder that may not be searched may have no file either.
        with suppress(OSError):
            partial.unlink()


def replace_text(path: Path, text: str) -> None:
    """Write a text file as :func:`replacing` does."""
    with replacing(path) as file:
        file.write(text.encode())


def claim(folder: Path) -> int | None:
    """Claim a folder until the handle that this gives is closed or the process ends, however it ends.

    None where another process has claimed it, or the system cannot tell.
    """
    try:
        import fcntl
    except ModuleNotFoundError:  # not a POSIX system
        return None
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        os.close(handle)
        return None
    return handle
