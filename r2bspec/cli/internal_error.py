"""The report of an unforeseen error: a line for the user, the traceback in a file."""

from __future__ import annotations

import os
from pathlib import Path

import msgspec

from r2bspec._version import __version__
from r2bspec.errors import ExitStatus, R2bspecError

_PACKAGE = Path(__file__).parents[1]

MAX_FAILURES = 10
"""Files whose check may end without a result before all others are left, too."""


class Crash(msgspec.Struct, frozen=True):
    """An unforeseen error in a form that another process can read.

    Attributes:
        kind: the name of its class.
        place: the last line of r2bspec on the way to it, such as ``cli/run.py:12``.
        doing: what was being done, such as the name of the file that was checked; may be empty.
        trace: the traceback.
    """

    kind: str
    place: str
    doing: str
    trace: str

    @classmethod
    def of(cls, error: BaseException, doing: str = "") -> Crash:
        """Describe an error that was raised."""
        return cls(type(error).__name__, _place(error), doing, "".join(_formatted(error)))


class InternalError(R2bspecError):
    """An error of r2bspec itself.

    The message has neither the text of the exception nor a value of the input, which may be a
    secret or hostile: those are in the file with the traceback, which only its owner can read.
    """

    code = "R2B690"
    exit_code = ExitStatus.INTERNAL_ERROR

    def __init__(self, crash: Crash) -> None:
        doing = f" {crash.doing}" if crash.doing else ""
        super().__init__(
            f"{crash.kind} in r2bspec ({crash.place}){doing}; report it to the issue tracker of "
            f"r2bspec, with the traceback {_keep(crash)}"
        )


class UncheckedFiles:
    """The files whose check crashed, while the check of others continues."""

    def __init__(self) -> None:
        self._failures: list[tuple[str, R2bspecError]] = []

    def add(self, name: str, failure: R2bspecError) -> None:
        """Keep the failure of a file.

        Raises:
            R2bspecError: the first failure, if there are so many that it is not a matter of files.
        """
        self._failures.append((name, failure))
        if len(self._failures) >= MAX_FAILURES:
            self.raise_first()

    def raise_first(self) -> None:
        """Raise the first failure, if there is one; its hint names the other files."""
        if not self._failures:
            return
        (_, first), *others = self._failures
        if others:
            names = ", ".join(repr(name) for name, _ in others)
            first.hint = f"{first.hint} Not checked either: {names}.".strip()
        raise first


def _formatted(error: BaseException) -> list[str]:
    import traceback

    try:
        return traceback.format_exception(error)
    except (RecursionError, MemoryError, ValueError):
        # A chain of causes can be too long as well; what happened last says enough then.
        return traceback.format_exception(error, chain=False, limit=-100)


def _place(error: BaseException) -> str:
    import traceback

    module_path = ""
    for frame, line in traceback.walk_tb(error.__traceback__):
        file = Path(frame.f_code.co_filename)
        if file.is_relative_to(_PACKAGE):
            module_path = f"{file.relative_to(_PACKAGE)}:{line}"
    return module_path or "before its first line"


def _keep(crash: Crash) -> str:
    """Write the traceback to a new file that only its owner can read; says where it is."""
    import platform
    import tempfile

    system = f"r2bspec {__version__}, Python {platform.python_version()}, {platform.platform()}"
    text = f"{system}\n{crash.doing}\n{crash.trace}"
    try:
        # A new name, made exclusively and with mode 0600: another user can neither read the file
        # nor have a link there.
        number, name = tempfile.mkstemp(prefix="r2bspec-crash-", suffix=".txt")
        with os.fdopen(number, "w", encoding="utf-8", errors="backslashreplace") as stream:
            stream.write(text)
    except OSError as error:
        return f"(which could not be written: {error.strerror or type(error).__name__})"
    return f"in {name}"
