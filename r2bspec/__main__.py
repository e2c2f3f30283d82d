"""``python -m r2bspec`` is the same as ``r2bspec``.

``-m`` makes Python look into the current folder first, so `r2bspec` takes that folder out of the
way when it is imported. That is too late for a module or a package called ``r2bspec`` in that
folder, which Python finds instead of this one, and for ``contextlib`` and ``importlib``, which
``-m`` itself imports.
The command ``r2bspec`` and ``python -P -m r2bspec`` never look into the current folder.
"""

import signal
import sys


def start() -> int:
    """Run the command line; returns the exit status.

    A Ctrl-C before its modules are imported ends the process by the signal, as it ends any program:
    nothing has begun that has to be ended, and Python would print a traceback.
    """
    is_handled = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if is_handled:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from r2bspec.cli.main import main

    if is_handled:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    return main()


if __name__ == "__main__":
    sys.exit(start())
