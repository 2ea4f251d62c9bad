"""Where the console script begins: light, so that Ctrl-C is answered in one line from the first moment on."""

from __future__ import annotations

import os
import signal
from types import FrameType


def main() -> None:
    """Run the command line; see ``sonarwarp.app.cli.main``."""
    # Where the shell has it ignored, as of a job in the background, it stays ignored.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)
    from sonarwarp.app import cli

    cli.main()


def _interrupt(_number: int, frame: FrameType | None) -> None:
    """Ctrl-C: an exception as always, but the end at once while a module loads.

    Loading, NumPy prints the exception with its traceback, and others take it for a fault of theirs.
    """
    while frame is not None:
        if frame.f_code.co_filename.startswith("<frozen importlib"):
            show_cursor = b"\x1b[?25h" if os.isatty(2) else b""  # bars hide it
            os.write(2, show_cursor + b"sonarwarp: interrupted\n")
            os._exit(130)
        frame = frame.f_back
    raise KeyboardInterrupt


if __name__ == "__main__":
    main()
