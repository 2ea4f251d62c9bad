"""A process that forks writers of a log for others to kill; modules load once.

It reads lines of JSON: where to write, and at which of its file operations the writer kills itself, or null. For each
it prints the writer's process, what the writer reports, and how it ended.
"""

import json
import os
import signal
import sys
from collections.abc import Callable
from typing import Any

import sonarwarp.store_read  # noqa: F401
from sonarwarp.store_write import StoreWriter
from tests.small_logs import small_log

FRAMES = 1000
ROUND = 7

# What changes the file system, or is about to, as ``sys.addaudithook`` names it.
_OPERATIONS = ("open", "os.rename", "os.mkdir", "os.remove", "os.link", "os.rmdir")


def say(**what: Any) -> None:
    print(json.dumps(what), flush=True)


def count_operations(last: int | None) -> Callable[[], int]:
    """Count file operations from now on, and end the process before number ``last``."""
    done = 0

    def hook(event: str, _arguments: tuple) -> None:
        nonlocal done
        if event in _OPERATIONS:
            done += 1
            if done == last:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(hook)
    return lambda: done


def write(path: str, last: int | None) -> None:
    log = small_log(FRAMES)
    per_frame = len(log.echoes) / FRAMES
    say(begin=True)
    operations = count_operations(last)
    with StoreWriter(path, log.survey) as writer:
        say(made=operations())
        for first in range(0, FRAMES, ROUND):
            end = min(first + ROUND, FRAMES)
            writer.append(log.images[first:end], log.echoes[round(first * per_frame) : round(end * per_frame)])
            say(frames=writer.frames_complete, pings=writer.pings_complete)
    say(operations=operations())
    if last is None:
        signal.pause()  # so that its number stays its own until it is killed
    os._exit(0)


def main() -> None:
    import zarr  # noqa: F401

    say(ready=True)
    for line in sys.stdin:
        order = json.loads(line)
        child = os.fork()
        if child == 0:
            write(order["path"], order["last"])
        say(child=child)
        _, status = os.waitpid(child, 0)
        say(signal=os.WTERMSIG(status) if os.WIFSIGNALED(status) else 0)


if __name__ == "__main__":
    main()
