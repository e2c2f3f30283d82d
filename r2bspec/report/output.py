"""The only way to write text to standard output and standard error.

Almost everything that is printed contains foreign texts: names of files and topics, messages of
exceptions, titles of results. Text that is printed here is made harmless (see
`r2bspec.diagnostics.plain_text`), so that no writer has to think of it.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, TextIO, cast

import click
import msgspec

from r2bspec.diagnostics import plain_text

if TYPE_CHECKING:
    from rich.console import Console


def echo(
    text: str = "",
    *,
    err: bool = False,
    nl: bool = True,
    lines: bool = False,
    styled: bool = False,
    commands: bool = False,
) -> None:
    """Print a line; line breaks inside names are replaced.

    Args:
        text: what to print.
        err: to standard error instead of standard output.
        nl: end the line; without, the text has all its line breaks.
        lines: the text has several lines.
        styled: the text has colours, around values that are plain.
        commands: the text is workflow commands that r2bspec made, with escaped values.
    """
    if nl and not lines:
        text = text.replace("\n", plain_text.REPLACEMENT)
    shown = plain_text.short_lines(plain_text.harmless(text, styled=styled, commands=commands))
    click.echo(shown, err=err, nl=nl, color=True if styled else None)


def echo_document(content: str | bytes, *, nl: bool = True) -> None:
    """Print a document for programs.

    Control characters, which only JSON can contain here, become escapes of JSON.
    """
    click.echo(
        plain_text.escaped_json(content.encode() if isinstance(content, str) else content), nl=nl
    )


def echo_json(content: object) -> None:
    """Print a value as indented JSON, for programs."""
    echo_document(msgspec.json.format(msgspec.json.encode(content), indent=2))


MAX_TABLE_ROWS: Final = 200
"""Of one table in a terminal, whatever it shows."""


def rows_left_out(number: int) -> str:
    """Return the line that counts the rows which a terminal table does not show."""
    return f"({number:,} more rows: --format json or --report json=FILE has all)"


def write(stream: TextIO, text: str) -> None:
    """Write a text to a stream at once, with or without colours around plain values."""
    stream.write(plain_text.short_lines(plain_text.harmless(text, styled=True)))
    stream.flush()


def printed_text(show: Callable[[Console], object], width: int) -> str:
    """Return what a console of this width shows: plain text without spaces at line ends."""
    buffer = io.StringIO()
    show(console(buffer, width=width, color_system=None, legacy_windows=False))
    return "".join(f"{line.rstrip()}\n" for line in buffer.getvalue().splitlines())


def console(stream: TextIO | None = None, **options: Any) -> Console:
    """Return a console of rich for standard output, or for `stream`, that prints harmless text."""
    from rich.console import Console
    from rich.segment import Segment

    class PlainConsole(Console):
        """Replaces control characters before styles become part of the text."""

        def render(self, *arguments: Any, **named: Any) -> Any:
            for segment in super().render(*arguments, **named):
                yield (
                    segment
                    if segment.control
                    else Segment(plain_text.plain(segment.text), segment.style)
                )

    target = _WithoutCommands(sys.stdout if stream is None else stream)
    return PlainConsole(file=cast("TextIO", target), **options)


class _WithoutCommands:
    """A stream whose lines are no commands, however a console has wrapped them."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        return self._stream.write(plain_text.without_commands(text))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)
