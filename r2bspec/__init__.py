"""State, run and gate performance benchmarks of ROS 2 graphs.

The names below are the public interface; each loads its stage on first use, so that ``import
r2bspec`` costs nothing and needs no ROS.
"""

import sys

# `python -m r2bspec` puts the current folder in front of everything that is imported: a json.py in
# a folder that a stranger wrote would be executed. It is taken out before the first import that
# could find one there. See r2bspec/__main__.py for what this cannot prevent.
if (
    not sys.flags.safe_path
    and sys.argv[:1] == ["-m"]  # while Python looks for the module that it is to execute
    and any(orig_word.removeprefix("-m").split(".")[0] == "r2bspec" for orig_word in sys.orig_argv)
):
    del sys.path[0]

from typing import TYPE_CHECKING, Any

from r2bspec._version import __version__
from r2bspec.errors import R2bspecError

if TYPE_CHECKING:
    from r2bspec.api import (
        InvalidSpecError,
        SpecSelection,
        compile_plan,
        judge,
        load,
        prepare,
        run,
        validate,
    )

__all__ = [
    "InvalidSpecError",
    "R2bspecError",
    "SpecSelection",
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
