"""A verb of r2bspec as the child of a worker, with which it ends."""

from __future__ import annotations

import os
import runpy
import signal
import sys
import threading


def _end_with_worker() -> None:
    """Interrupt this process when the worker is gone, which has the other end of the pipe."""
    while os.read(sys.stdin.fileno(), 1):
        pass
    os.kill(os.getpid(), signal.SIGTERM)


if __name__ == "__main__":
    threading.Thread(target=_end_with_worker, daemon=True).start()
    # The command line is above this package, which therefore cannot import it.
    runpy.run_module("r2bspec", run_name="__main__", alter_sys=True)
