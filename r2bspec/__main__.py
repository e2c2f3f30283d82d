"""``python -m r2bspec`` is the same as ``r2bspec``.

``-m`` makes Python look into the current folder first, so `r2bspec` takes that folder out of the
way when it is imported. That is too late for a module or a package called ``r2bspec`` in that
folder, which Python finds instead of this one, and for ``contextlib`` and ``importlib``, which
``-m`` itself imports.
The command ``r2bspec`` and ``python -P -m r2bspec`` never look into the current folder.
"""

import sys

from r2bspec.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
