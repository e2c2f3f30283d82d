"""Differences between the gates of two specs, and the two sides that are compared."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import msgspec

from r2bspec.diagnostics.diagnostic import Path, Span
from r2bspec.diagnostics.quote import clip
from r2bspec.language.declaration import encode_text
from r2bspec.language.quantities import Duration, Rate, Share, Size
from r2bspec.plan.comparability import ABSENT, PlanDifference

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec
    from r2bspec.language.spec import Spec
    from r2bspec.plan.plan import Plan

_MAX_TEXT = 100


class GateSide(Protocol):
    """A prepared benchmark: its plan, and the document unless the plan is from a file."""

    @property
    def plan(self) -> Plan:
        """The compiled plan."""
        raise NotImplementedError

    @property
    def loaded(self) -> LoadedSpec | None:
        """The document from which it was compiled."""
        raise NotImplementedError


class GateChange(NamedTuple):
    """A difference that a verdict may depend on.

    Attributes:
        name: of the key or of the object, such as ``duration`` or ``objective fast``.
        path: of the value in the head's document.
        before: the value of the base as text; empty if it has none.
        after: the value of the head as text; empty if it has none.
        weaker: whether the head's gate is weaker because of it, or may be; otherwise it is
            stronger.
        span: the place in the head, if it is not at `path`.
    """

    name: str
    path: Path
    before: str
    after: str
    weaker: bool
    span: Span | None = None


def spec_of(side: GateSide) -> Spec | None:
    """The typed document of a side; None for a plan from a file."""
    return side.loaded.spec if side.loaded is not None else None


def unique(changes: Iterator[GateChange]) -> Iterator[GateChange]:
    """The changes with each text at each place once."""
    return iter(dict.fromkeys(changes))


def duration_text(ns: int) -> str:
    """A duration with its unit."""
    return str(Duration(ns))


def rate_text(hz: float) -> str:
    """A rate with its unit; 0 is the rate of the recording, or of the graph itself."""
    return str(Rate(hz)) if hz else "the rate of the source"


def share_text(fraction: float) -> str:
    """A share in percent."""
    return str(Share(fraction))


def size_text(size_bytes: int) -> str:
    """A size with its unit."""
    return str(Size(size_bytes))


def value_text(value: Any) -> str:
    """Any value of a plan, as brief JSON; a text as it is."""
    if value is None or value is msgspec.UNSET:
        return "none"
    if isinstance(value, str):
        return clip(value, _MAX_TEXT) or "none"
    return clip(msgspec.json.encode(value, enc_hook=encode_text).decode(), _MAX_TEXT)


class Key(NamedTuple):
    """A key, and which change of its value is weaker.

    Attributes:
        name: of the change.
        path: in the document.
        order: gives a number that is smaller where the gate is weaker; None if there is no order.
        text: the value for people.
    """

    name: str
    path: Path
    order: Callable[[Any], float] | None = None
    text: Callable[[Any], str] = value_text

    def changes(self, before: Any, after: Any) -> Iterator[GateChange]:
        """The change from one value to another, if they differ."""
        if before == after:
            return
        weaker = self.order is None or self.order(after) < self.order(before)
        yield GateChange(self.name, self.path, self.text(before), self.text(after), weaker)


def less_is_weaker(value: float) -> float:
    """The order of a number that a weaker gate has less of."""
    return value


def more_is_weaker(value: float) -> float:
    """The order of a number that a weaker gate has more of."""
    return -value


def rank(*values: Any) -> Callable[[Any], float]:
    """The order of values of which the first is the weakest."""
    return values.index


def difference_texts(difference: PlanDifference) -> tuple[str, str]:
    """The two values of a difference of plans; empty where there is none."""
    return _json_text(difference.before), _json_text(difference.after)


def _json_text(value: Any) -> str:
    return "" if value is ABSENT else value_text(json.dumps(value, ensure_ascii=False))
