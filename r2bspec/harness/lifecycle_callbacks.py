"""Why a transition of a Python lifecycle node failed, as a line of its process.

rclpy takes an exception in the callback of a transition for its result, and says nothing of it; of
a callback that returns nothing, the whole process ends. Both are said here.
"""

from __future__ import annotations

import functools
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rclpy.node import Node

from r2bspec.ipc.protocol import callback_failure

_REGISTER = "_LifecycleNodeMixin__register_callback"


def is_lifecycle_node(node: Node) -> bool:
    """Whether a node has states."""
    mixin = _mixin()
    return mixin is not None and isinstance(node, mixin)


def report_failures() -> None:
    """Let the lifecycle nodes of this process, of all imported classes, say why they failed."""
    mixin = _mixin()
    register = getattr(mixin, _REGISTER, None)
    if register is None or hasattr(register, "__wrapped__"):
        return

    @functools.wraps(register)
    def register_reporting(node: Any, state: int, callback: Callable[[Any], Any]) -> Any:
        return register(node, state, _reporting(node, callback))

    setattr(mixin, _REGISTER, register_reporting)


def _mixin() -> Any:
    """The class with the states; None as long as nobody has imported it."""
    return getattr(sys.modules.get("rclpy.lifecycle"), "LifecycleNodeMixin", None)


def _reporting(node: Node, callback: Callable[[Any], Any]) -> Callable[[Any], Any]:
    from rclpy.lifecycle import TransitionCallbackReturn

    name = getattr(callback, "__name__", "a callback")

    @functools.wraps(callback)
    def call(state: Any) -> Any:
        begin = callback_failure(node.get_fully_qualified_name(), name)
        try:
            result = callback(state)
        except Exception as error:
            traceback.print_exc()
            place = traceback.extract_tb(error.__traceback__)[-1]
            where = f"{Path(place.filename).name}, line {place.lineno}"
            _say(f"{begin}raised {type(error).__name__}: {error} ({where})")
            raise
        if not isinstance(result, TransitionCallbackReturn):
            _say(f"{begin}returned {result!r}, which is no TransitionCallbackReturn")
            return TransitionCallbackReturn.ERROR
        return result

    return call


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
