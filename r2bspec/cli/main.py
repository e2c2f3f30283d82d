"""The `r2bspec` command: dispatches to a verb, prints errors with a hint, sets the exit status.

`r2bspec.errors` has every exit status, for every verb.
"""

from __future__ import annotations

import contextlib
import errno
import importlib
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType
from typing import Any

import click

from r2bspec._version import __version__
from r2bspec.diagnostics.plain_text import message_text, short_lines
from r2bspec.diagnostics.quote import quote
from r2bspec.errors import ExitStatus, R2bspecError, UsageError, exit_status_text
from r2bspec.report.output import echo
from r2bspec.safe_io.cache_folder import passed_over
from r2bspec.safe_io.terminal import leave_terminal

VERBS = {
    "init": "Create a commented spec to start from.",
    "validate": "Check specs without running anything.",
    "interfaces": "Start each node once and record its interface.",
    "plan": "Show the plan of a run, as JSON or as a diagram.",
    "run": "Run a benchmark on real ROS 2 and judge it by its SLOs.",
    "gate": "Gate a change of a repository: compare specs and their code with a base.",
    "judge": "Judge a finished run again, or propose objectives from it.",
    "report": "Write reports of a finished run: HTML, JUnit, Markdown and others.",
    "compare": "Play two specs in pairs, or compare finished runs.",
    "trend": "Show how metrics of finished runs changed over time, and since which commit.",
    "tune": "Find the values that meet the objectives at the least cost.",
    "import": "Make specs from scripts of ros2_benchmark and launch files.",
    "data": "List, create, inspect and verify datasets.",
    "doctor": "Check this machine's fitness for benchmarking.",
    "fleet": "Run benchmarks on the hosts of a fleet.",
    "lsp": "Start the language server, for editors.",
    "docs": "Show the documentation, a JSON Schema, a diagnostic code or a metric.",
}
"""Each verb and its line in the help, so that listing them needs no import."""

_PLACES = {
    "init": "authoring:init_command",
    "interfaces": "authoring:interfaces_command",
    "judge": "finished_runs:judge_command",
    "report": "finished_runs:report_command",
    "import": "import_:command",
}
"""Where the command of a verb is, if not under the name `command` in a module of its own."""


_MAX_ERROR_LINE = 1_000
"""Characters: a message names files, whose names may have 4,000, and arguments of any length."""

_STREAMS = (("stdin", "r"), ("stdout", "w"), ("stderr", "w"))
"""In the order of their descriptors; one that is closed at the start is None."""

_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG})
"""No fault of r2bspec: the file system, or a limit on the size of files, leaves no room."""

_CLOSED = frozenset({errno.EACCES, errno.EPERM, errno.ELOOP, errno.EROFS})
"""Nor is it that the user may not look into a folder, or that a path leads to itself."""

COMPLETE = "_R2BSPEC_COMPLETE"
"""Set by a completion script when it asks for proposals; the name is click's for ``r2bspec``."""


class _Verbs(click.Group):
    """Imports a verb's module on demand, so that start-up pays for one verb only."""

    def list_commands(self, _ctx: click.Context) -> list[str]:
        return list(VERBS)

    def get_command(self, _ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in VERBS:
            return None
        place, _, name = _PLACES.get(cmd_name, f"{cmd_name}:command").partition(":")
        module = importlib.import_module(f"r2bspec.cli.{place}")
        loaded_command: click.Command = getattr(module, name)
        return loaded_command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args and args[0] not in VERBS and not args[0].startswith("-"):
            from r2bspec.diagnostics import did_you_mean

            close = did_you_mean(args[0], VERBS)
            ctx.fail(
                f"unknown verb {args[0]!r}"
                + (f"; did you mean {close!r}?" if close else f"; verbs: {', '.join(VERBS)}")
            )
        return super().resolve_command(ctx, args)

    def format_commands(self, _ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Verbs"):
            formatter.write_dl(list(VERBS.items()))


@click.group(
    cls=_Verbs,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=f"Documentation: 'r2bspec docs'. Exit status: {exit_status_text()}.",
)
@click.version_option(__version__, "-V", "--version", message="r2bspec %(version)s")
def command() -> None:
    """Specify, run and gate performance benchmarks of ROS 2 graphs."""


def main(argv: list[str] | None = None) -> int:
    """Run the command line, and return the exit status."""
    _open_standard_streams()
    output = sys.stdout
    is_ours = output is sys.__stdout__ and isinstance(output, io.TextIOWrapper)
    if is_ours and isinstance(output.buffer, io.RawIOBase):
        # With PYTHONUNBUFFERED, what a pipe does not take at once would be lost.
        encoding = output.encoding
        whole = io.BufferedWriter(output.detach())
        sys.stdout = io.TextIOWrapper(whole, encoding, line_buffering=True)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # What the encoding of a terminal lacks shows as a question mark, not as a crash.
            stream.reconfigure(errors="replace")
    try:
        _require_arguments(sys.argv[1:] if argv is None else argv)
        with _notes_on_caches(), _interruptible():
            status = _called(sys.argv[1:] if argv is None else argv)
        sys.stdout.flush()
    except R2bspecError as error:
        show_error(error)
        return error.exit_code
    except (click.exceptions.Abort, KeyboardInterrupt):
        echo("interrupted", err=True)
        return ExitStatus.INTERRUPTED
    except click.ClickException as error:
        shown = io.StringIO()
        vars(error)["message"] = message_text(error.message)  # a field that is declared final
        error.show(file=shown)
        echo(short_lines(shown.getvalue(), _MAX_ERROR_LINE), err=True, nl=False)
        return ExitStatus.USAGE
    except click.exceptions.Exit as error:
        return error.exit_code
    except BrokenPipeError:
        # The reader of our output has closed the pipe, as `head` does; the interpreter must not
        # try to flush at exit.
        _discard_output()
        return ExitStatus.OUTPUT_CLOSED
    except Exception as error:
        if isinstance(error, OSError) and error.errno in _FULL:
            _discard_output()
            what = error.filename or "the output"
            full = UsageError(
                f"{what} cannot be written: {error.strerror}",
                hint="Make room, raise the limit (ulimit -f), or write to another file system.",
                code="R2B651",
            )
            with contextlib.suppress(OSError):
                show_error(full)
            return full.exit_code
        if isinstance(error, OSError) and error.errno in _CLOSED and error.filename is not None:
            closed = UsageError(
                f"{os.fsdecode(error.filename)} cannot be used: {error.strerror}",
                hint="Name another path, or change the permissions of its folders.",
                code="R2B651",
            )
            show_error(closed)
            return closed.exit_code
        if isinstance(error, FileNotFoundError) and _is_folder_gone():
            gone = UsageError("the current folder was removed", hint="Change to one that exists.")
            show_error(gone)
            return gone.exit_code
        from r2bspec.cli.internal_error import InternalError

        failure = InternalError(error)
        for note in getattr(error, "__notes__", ()):
            failure.add_note(note)
        show_error(failure)
        return failure.exit_code
    return status if isinstance(status, int) else ExitStatus.OK


def _called(arguments: list[str]) -> Any:
    """Return what the verb returns; for a completion script, its proposals are printed.

    Raises:
        UsageError: such a script asks for what no shell would.
    """
    if asked := os.environ.get(COMPLETE):
        from click.shell_completion import shell_complete

        with contextlib.suppress(KeyError, ValueError):
            if shell_complete(command, {}, "r2bspec", COMPLETE, asked) == 0:
                return ExitStatus.OK
        raise UsageError(
            f"{COMPLETE}, COMP_WORDS, COMP_CWORD are not as the completion of a shell sets them",
            hint=f"Unset them, or write the script anew: {COMPLETE}=bash_source r2bspec.",
        )
    # Not `main` of click, which takes a `BrokenPipeError` for itself, and exits with 1.
    with command.make_context("r2bspec", [*arguments]) as context:
        return command.invoke(context)


def _is_folder_gone() -> bool:
    """Return whether the current folder was removed, which only paths without a root notice."""
    try:
        os.getcwd()  # noqa: PTH109
    except FileNotFoundError:
        return True
    return False


def _require_arguments(arguments: list[str]) -> None:
    """See that none is empty: it would name the current folder, or count as left out.

    Raises:
        UsageError: one is.
    """
    if "" in arguments:
        before = arguments[: arguments.index("")]
        after = f" after {quote(before[-1])}" if before else ""
        raise UsageError(
            f"argument {len(before) + 1}{after} is empty",
            hint="Leave it out, or give a value: a variable of the shell may not be set.",
        )


def _open_standard_streams() -> None:
    """Open what the caller has closed: a file of the run would get its number, and the output.

    Output waits for its reader: where the caller does not, what exceeds a pipe would be lost.
    """
    while (opened := os.open(os.devnull, os.O_RDWR)) < len(_STREAMS):
        os.set_inheritable(opened, True)
    os.close(opened)
    for number, (name, mode) in enumerate(_STREAMS):
        if getattr(sys, name) is None:
            setattr(sys, name, open(number, mode))  # noqa: PTH123, SIM115
        if mode == "w":
            with contextlib.suppress(OSError):
                os.set_blocking(number, True)


def _discard_output() -> None:
    """Let the flush at the exit of the interpreter succeed."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextlib.contextmanager
def _notes_on_caches() -> Iterator[None]:
    """Say at the end which caches were not used, and why."""
    passed_over.clear()
    try:
        yield
    finally:
        for note in passed_over:
            echo(note, err=True)


@contextlib.contextmanager
def _interruptible() -> Iterator[None]:
    """While active, SIGTERM ends a verb as Ctrl-C does, and so does the end of its terminal.

    `run` has handlers of its own meanwhile. What was started with nohup survives its terminal.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def interrupt(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGHUP:
            leave_terminal()
        signal.default_int_handler(number, frame)

    before = {
        each: signal.signal(each, interrupt)
        for each in (signal.SIGTERM, signal.SIGHUP)
        if each is signal.SIGTERM or signal.getsignal(each) is not signal.SIG_IGN
    }
    try:
        yield
    finally:
        for each, handler in before.items():
            signal.signal(each, handler)


def show_error(error: R2bspecError) -> None:
    """Print an error as a line and a hint, with the notes that were added to it."""
    if error.remainder is None:
        _show_message(error)
    elif error.remainder:
        echo(error.remainder, err=True, lines=True)
    for note in getattr(error, "__notes__", ()):
        echo(message_text(note), err=True, lines=True)


def _show_message(error: R2bspecError) -> None:
    from r2bspec.report.findings_text import code_with_slug

    colour = sys.stderr.isatty() and "NO_COLOR" not in os.environ
    label = f"error[{code_with_slug(error.code)}]"
    shown = click.style(label, fg="red", bold=True) if colour else label
    message = short_lines(message_text(str(error)), _MAX_ERROR_LINE)
    echo(f"{shown}: {message}", err=True, lines=True, styled=colour)
    if error.hint:
        echo(f"  help: {short_lines(error.hint, _MAX_ERROR_LINE)}", err=True)
