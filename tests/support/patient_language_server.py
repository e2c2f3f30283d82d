"""The language server for tests of what it answers, which wait for its analysis on busy machines.

A request waits for the analysis of a change for half a second, so that an editor never hangs; what
it answers then may be of the text before. Tests of that wait start the server itself.
"""

from __future__ import annotations

import sys

COMMAND = [sys.executable, __file__]


def main() -> int:
    """Serve, and let requests wait for as long as a busy machine takes."""
    from r2bspec.cli.main import main as r2bspec
    from r2bspec.language_server import server

    vars(server)["MAX_WAIT_S"] = 60.0
    return r2bspec(["lsp"])


if __name__ == "__main__":
    sys.exit(main())
