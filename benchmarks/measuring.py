"""What all benchmarks do: start runs, name the machine, print tables in Markdown."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path


def options(doc: str | None) -> argparse.ArgumentParser:
    """A parser that shows the docstring of a program."""
    return argparse.ArgumentParser(
        description=doc, formatter_class=argparse.RawDescriptionHelpFormatter
    )


def tell(text: str) -> None:
    """Say how far the program is."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201 - a program


def show(*lines: str) -> None:
    """Print a part of the result."""
    print("\n".join(lines), flush=True)  # noqa: T201 - a program


def show_section(page: Path | None, section: str, lines: Sequence[str]) -> None:
    """Print a section, and put it in its place on the page if there is one."""
    show(*lines, "")
    if page is not None:
        begin, end = f"<!-- measured: {section} -->\n", "<!-- end -->"
        before, _, rest = page.read_text(encoding="utf-8").partition(begin)
        text = "\n".join(lines)
        page.write_text(f"{before}{begin}{text}\n{end}{rest.partition(end)[2]}")


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """The lines of a table."""
    yield f"| {' | '.join(head)} |"
    yield "| --- " * len(head) + "|"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def machine() -> str:
    """What the figures are true of."""
    return (
        f"{len(os.sched_getaffinity(0))} cores, {platform.machine()}, Linux {platform.release()}, "
        f"Python {platform.python_version()}"
    )
