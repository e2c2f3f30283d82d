"""The report of an unforeseen error: a line for the user, the traceback in a file."""

from __future__ import annotations

import os
from pathlib import Path

from r2bspec._version import __version__
from r2bspec.errors import ExitStatus, R2bspecError

_PACKAGE = Path(__file__).parents[1]


class InternalError(R2bspecError):
    """An error of r2bspec itself.

    The message has neither the text of the exception nor a value of the input, which may be a
    secret or hostile: those are in the file with the traceback, which only its owner can read.
    """

    code = "R2B690"
    exit_code = ExitStatus.INTERNAL_ERROR

    def __init__(self, error: BaseException) -> None:
        """Describe an unforeseen error."""
        super().__init__(
            f"{type(error).__name__} in r2bspec ({_place(error)}); report it to the issue tracker "
            f"of r2bspec, with the traceback {_keep(''.join(_formatted(error)))}"
        )


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


def _keep(trace: str) -> str:
    """Write the traceback to a new file that only its owner can read; says where it is."""
    import platform
    import tempfile

    system = f"r2bspec {__version__}, Python {platform.python_version()}, {platform.platform()}"
    text = f"{system}\n{trace}"
    try:
        # A new name, made exclusively and with mode 0600: another user can neither read the file
        # nor have a link there.
        number, name = tempfile.mkstemp(prefix="r2bspec-crash-", suffix=".txt")
        with os.fdopen(number, "w", encoding="utf-8", errors="backslashreplace") as stream:
            stream.write(text)
    except OSError as error:
        return f"(which could not be written: {error.strerror or type(error).__name__})"
    return f"in {name}"
