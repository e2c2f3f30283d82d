"""The progress of a run on standard error: a live line on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console
    from rich.status import Status


class _Lines:
    """One plain line for each thing that happens, with the seconds since the start."""

    def __init__(self) -> None:
        self._began = time.monotonic()

    def _say(self, text: str) -> None:
        sys.stderr.write(f"[{time.monotonic() - self._began:6.1f} s] {text}\n")
        sys.stderr.flush()

    def phase(self, _name: str, text: str) -> None:
        self._say(text)

    def step(self, done: int, total: int) -> None:
        """A count would be a line for every message."""

    def segment(self, title: str, _steps: int) -> None:
        self._say(f"  {title}")

    def playing(self, sent: int, received: int) -> None:
        """The next segment tells enough."""

    def note(self, text: str) -> None:
        self._say(f"  {text}")


class _Live:
    """A line that changes in place; phases and notes stay above it."""

    def __init__(self, console: Console, status: Status) -> None:
        self._console = console
        self._status = status
        self._began = time.monotonic()
        self._phase = ""
        self._title = ""
        self._steps = 0

    def _show(self, detail: str = "") -> None:
        elapsed = time.monotonic() - self._began
        self._status.update(f"[bold]{self._phase}[/bold]  {detail}  [dim]{elapsed:.0f} s[/dim]")

    def phase(self, _name: str, text: str) -> None:
        self._phase, self._title = text, ""
        self._show()

    def step(self, done: int, total: int) -> None:
        self._show(f"{done}/{total}")

    def segment(self, title: str, steps: int) -> None:
        self._title, self._steps = title, steps
        self._show(title)

    def playing(self, sent: int, received: int) -> None:
        self._show(f"{self._title}: {sent}/{self._steps} sent, {received} received")

    def note(self, text: str) -> None:
        self._console.print(f"  {text}", markup=False, highlight=False, style="dim")


class _Quiet(_Lines):
    """Says nothing at all."""

    def _say(self, text: str) -> None:
        """Swallow the line."""


@contextlib.contextmanager
def shown_progress(*, quiet: bool = False) -> Iterator[_Lines | _Live]:
    """A listener for a run that shows what it is told, for as long as the context lasts.

    CI systems keep what is printed, so a live line there would be a thousand lines; ``CI=true``
    is taken at its word.
    """
    if quiet:
        yield _Quiet()
    elif not sys.stderr.isatty() or os.environ.get("CI"):
        yield _Lines()
    else:
        from rich.console import Console

        console = Console(stderr=True)
        with console.status("starting") as status:
            yield _Live(console, status)
