"""``python -m r2bspec`` is the same as ``r2bspec``."""

import gc
import sys


def start() -> int:
    """Run the command line; what its modules define is never garbage, and is not looked through."""
    gc.disable()
    from r2bspec.cli.main import main

    gc.freeze()
    gc.enable()
    try:
        return main()
    finally:
        # The end of the process frees the rest.
        gc.freeze()


if __name__ == "__main__":
    sys.exit(start())
