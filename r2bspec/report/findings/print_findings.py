"""Printing findings on a terminal, for every verb that reads a spec."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from typing import TextIO

from r2bspec.diagnostics import Diagnostic
from r2bspec.report.findings import text
from r2bspec.report.output import write


def show(
    diagnostics: Iterable[Diagnostic], sources: Mapping[str, str], stream: TextIO | None = None
) -> None:
    """Write findings as text to `stream`, standard error by default."""
    target = sys.stderr if stream is None else stream
    write(target, text.render(diagnostics, sources, colour=wants_colour(target)))


def wants_colour(stream: TextIO) -> bool:
    """Whether to use colours: on a terminal, unless NO_COLOR, CI or TERM forbid it."""
    silenced = os.environ.get("NO_COLOR") or os.environ.get("CI") == "true"
    return stream.isatty() and not silenced and os.environ.get("TERM") != "dumb"
