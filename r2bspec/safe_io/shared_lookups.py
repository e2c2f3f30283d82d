"""Answers about the machine that the checks of many documents share."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from functools import wraps
from typing import Any, Final, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

_ANSWERS: Final[ContextVar[dict[Any, Any] | None]] = ContextVar("answers", default=None)


@contextlib.contextmanager
def shared_lookups() -> Iterator[None]:
    """Call functions with `shared_lookup` once for each argument in the block."""
    token = _ANSWERS.set({})
    try:
        yield
    finally:
        _ANSWERS.reset(token)


def shared_lookup(function: Callable[P, R]) -> Callable[P, R]:
    """Let many checks share the answers of a function that looks up files.

    Its arguments must be hashable, and nothing may change its result. Exceptions are not shared.
    """

    @wraps(function)
    def ask(*args: P.args, **kwargs: P.kwargs) -> R:
        answers = _ANSWERS.get()
        if answers is None:
            return function(*args, **kwargs)
        question = (function, args, *kwargs.items())
        if question not in answers:
            answers[question] = function(*args, **kwargs)
        answer: R = answers[question]
        return answer

    return ask
