"""Differences between the gates of two specs, and the two sides that are compared."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec

from r2bspec.diagnostics.diagnostic import Path, Span
from r2bspec.diagnostics.quote import clip
from r2bspec.language.declaration import encode_text
from r2bspec.language.quantities import Rate
from r2bspec.plan.comparability import ABSENT, PlanDifference

if TYPE_CHECKING:
    from r2bspec.language.spec import Spec
    from r2bspec.plan.prepared_benchmark import PreparedBenchmark

_MAX_TEXT = 100


class GateChange(NamedTuple):
    """A difference that a verdict may depend on.

    Attributes:
        name: of the key or of the object, such as ``duration`` or ``objective fast``: what
            ``--allow`` takes.
        path: of the value in the head's document; the value may be gone.
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
    weaker: bool = True
    span: Span | None = None

    @classmethod
    def between(
        cls, name: str, path: Path, texts: Iterable[str], *, weaker: bool = True
    ) -> GateChange:
        """The change from the first of two texts to the second."""
        before, after = texts
        return cls(name, path, before, after, weaker)

    @property
    def text(self) -> str:
        """Both values, the new one first."""
        if not self.after:
            return f"gone, was {self.before}" if self.before else "gone"
        return f"{self.after}, was {self.before}" if self.before else f"new, {self.after}"


def spec_of(side: PreparedBenchmark) -> Spec | None:
    """The typed document of a side; None for a plan from a file."""
    return side.loaded.spec if side.loaded is not None else None


def rate_text(hz: float) -> str:
    """A rate with its unit; 0 is the rate of the recording, or of the graph itself."""
    return str(Rate(hz)) if hz else "the rate of the source"


def value_text(value: Any) -> str:
    """Any value of a plan, as brief JSON; a text as it is."""
    if value is None or value is msgspec.UNSET:
        return "none"
    if isinstance(value, str):
        return clip(value, _MAX_TEXT) or "none"
    return clip(msgspec.json.encode(value, enc_hook=encode_text).decode(), _MAX_TEXT)


class GateKey(NamedTuple):
    """A key, and which change of its value is weaker.

    Attributes:
        name: of the change.
        path: in the document.
        order: gives a number that is smaller where the gate is weaker; None if there is no order.
        text: the value for people, such as its quantity.
    """

    name: str
    path: Path
    order: Callable[[Any], float] | None = None
    text: Callable[[Any], object] = value_text

    def changes(self, before: Any, after: Any) -> Iterator[GateChange]:
        """The change from one value to another, if they differ."""
        if before != after:
            weaker = self.order is None or self.order(after) < self.order(before)
            texts = str(self.text(before)), str(self.text(after))
            yield GateChange(self.name, self.path, *texts, weaker)


def rank(*values: Any) -> Callable[[Any], float]:
    """The order of values of which the first is the weakest."""
    return values.index


def field_changes(
    was: msgspec.Struct,
    now: msgspec.Struct,
    name: str,
    path: Path,
    keys: Mapping[str, str | GateKey],
) -> Iterator[GateChange]:
    """The changes of all fields of two values of one type.

    Args:
        was: the value of the base.
        now: the value of the head.
        name: of the changes, with the name of the field in the place of ``*``.
        path: in the document.
        keys: of the fields, below the path, with dots in it; one that is not there has the name of
            its field. Without an order each change is weaker.
    """
    for field in was.__struct_fields__:
        key = keys.get(field, field)
        if isinstance(key, str):
            key = GateKey(name.replace("*", field), (*path, *key.split(".")))
        yield from key.changes(getattr(was, field), getattr(now, field))


def difference_change(difference: PlanDifference, name: str, path: Path) -> GateChange:
    """A difference of two plans, as a change that weakens the gate unless it is known not to."""
    texts = (
        "" if value is ABSENT else value_text(json.dumps(value, ensure_ascii=False))
        for value in (difference.before, difference.after)
    )
    return GateChange.between(name, path, texts)
