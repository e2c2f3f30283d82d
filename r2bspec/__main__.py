"""``python -m r2bspec`` is the same as ``r2bspec``."""

import sys

from r2bspec.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
