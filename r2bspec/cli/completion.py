"""``r2bspec completion``: the script with which a shell completes command lines of r2bspec."""

from __future__ import annotations

import click
from click.shell_completion import get_completion_class

from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo_document

_VARIABLE = "_R2BSPEC_COMPLETE"
"""Set by the script when it asks for proposals; the name is click's for ``r2bspec``."""


@click.command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def command(shell: str) -> int:
    """Print the completion script of SHELL.

    For bash: r2bspec completion bash > ~/.local/share/bash-completion/completions/r2bspec
    """
    from r2bspec.cli.main import command as r2bspec

    made = get_completion_class(shell)
    assert made is not None  # noqa: S101 - click has all of these shells
    # Its constructor looks for no shell; only bash's checks the version, and that of the user.
    script = made(r2bspec, {}, "r2bspec", _VARIABLE)
    echo_document(script.source_template % script.source_vars())
    return ExitStatus.OK
