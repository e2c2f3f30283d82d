"""What all benchmarks do: start runs, name the machine, print tables in Markdown."""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Iterable, Iterator, Sequence


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
