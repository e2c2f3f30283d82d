"""State, run and gate performance benchmarks of ROS 2 graphs.

The names below are all there is to import; each loads its stage when it is first used, so that
``import r2bspec`` costs nothing and needs no ROS.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from r2bspec._version import __version__
from r2bspec.errors import R2bspecError

if TYPE_CHECKING:
    from r2bspec.api import InvalidSpecError, compile_plan, judge, load, prepare, run, validate

__all__ = [
    "InvalidSpecError",
    "R2bspecError",
    "__version__",
    "compile_plan",
    "judge",
    "load",
    "prepare",
    "run",
    "validate",
]


def __getattr__(name: str) -> Any:
    if name in __all__:
        from r2bspec import api

        return getattr(api, name)
    raise AttributeError(f"module 'r2bspec' has no attribute {name!r}")
