"""What a search for a deployment cannot go on with."""

from __future__ import annotations

from importlib.util import find_spec

from r2bspec.diagnostics.quote import quoted_list
from r2bspec.errors import UsageError


class TuningError(UsageError):
    """The spec, its objectives or this installation leave nothing to search for."""

    code = "R2B808"


def require_extra() -> None:
    """See that the extra `tune` is installed, before anything is played.

    Raises:
        TuningError: a part of it is missing.
    """
    missing = [name for name in ("jinja2", "matplotlib", "optuna") if find_spec(name) is None]
    if missing:
        raise TuningError(
            f"the search needs {quoted_list(missing)}, which this installation does not have",
            hint="Install it: pip install 'r2bspec[tune]'.",
        )
