"""``r2bspec lsp``: the language server, for editors."""

from __future__ import annotations

import sys
from collections.abc import Callable
from io import BufferedReader, FileIO

import click

from r2bspec.cli.internal_error import Crash, InternalError
from r2bspec.errors import ExitStatus, UsageError


@click.command("lsp")
def command() -> int:
    """Start the language server on standard input and output, for an editor.

    Editors start it themselves; see 'r2bspec docs editors'. As its protocol says, it ends with 1
    where an editor leaves without a word.
    """
    import asyncio

    try:
        from r2bspec.language_server.server import create_server
    except ImportError as error:
        raise UsageError(
            "the language server needs lsprotocol", hint="pip install 'r2bspec[editor]'"
        ) from error
    # Not the object of `sys`, which the interpreter closes at its end, even if it is being read.
    stdin: BufferedReader = BufferedReader(FileIO(0, closefd=False), 1 << 16)
    server = create_server(defects_in_files())
    is_asked = asyncio.run(server.connection.serve(stdin, sys.stdout.buffer))
    return ExitStatus.OK if is_asked else ExitStatus.FINDINGS_OR_FAILED


def defects_in_files() -> Callable[[BaseException], str]:
    """What says in a line what no code foresaw; of one defect there is one file, however often."""
    defects: dict[str, str] = {}

    def told(error: BaseException) -> str:
        crash = Crash.of(error, "in the language server")
        name = f"{crash.kind} {crash.place}"
        if name not in defects:
            defects[name] = str(InternalError(crash))
        return defects[name]

    return told
