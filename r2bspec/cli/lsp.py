"""``r2bspec lsp``: the language server, for editors."""

from __future__ import annotations

import os

import click

from r2bspec.errors import ExitStatus, UsageError
from r2bspec.extras import install_command


@click.command("lsp")
def command() -> int:
    """Start the language server on standard input and output, for an editor.

    Editors start it themselves; see 'r2bspec docs editors'.
    """
    try:
        from r2bspec.language_server.server import create_server
    except ImportError as error:
        raise UsageError(
            "the language server needs pygls", hint=install_command("editor")
        ) from error
    # A copy: the server closes its output when it ends.
    create_server().start_io(stdout=os.fdopen(os.dup(1), "wb"))
    return ExitStatus.OK
