"""``python -m r2bspec`` is the same as ``r2bspec``."""

import sys

from r2bspec.cli.main import main as start

if __name__ == "__main__":
    sys.exit(start())
