"""The combinations of values that a search may try.

A combination has a place for each path of ``tune.values``: 0 is the value that the spec has, 1 the
first of those that are listed. It is put into the spec as ``--set`` does it, so a combination is
checked and compiled by the same code as every spec.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

from r2bspec.diagnostics.diagnostic import format_path
from r2bspec.language.variables import parse_path

Combination = tuple[int, ...]

TODAY: Final = "today's"
"""What the combination without a change is called."""


@dataclass(frozen=True)
class Space:
    """The values to try, by the paths of their keys."""

    values: Mapping[str, Sequence[Any]]

    @property
    def sizes(self) -> tuple[int, ...]:
        """The number of values of each path, that of the spec included."""
        return tuple(1 + len(values) for values in self.values.values())

    @property
    def today(self) -> Combination:
        """The combination that is the spec as it is."""
        return (0,) * len(self.values)

    def changes(self, combination: Combination) -> dict[str, Any]:
        """The values that differ from the spec, by path."""
        return {
            path: values[place - 1]
            for (path, values), place in zip(self.values.items(), combination, strict=True)
            if place
        }

    def single_changes(self) -> list[Combination]:
        """Every listed value alone: the first of each path before the second of any."""
        return [
            tuple(place if path == changed else 0 for path in range(len(self.sizes)))
            for place in range(1, max(self.sizes, default=1))
            for changed, size in enumerate(self.sizes)
            if place < size
        ]


def assignments(changes: Mapping[str, Any]) -> list[str]:
    """The changes as ``--set`` takes them."""
    return [f"{path}={json.dumps(value, ensure_ascii=False)}" for path, value in changes.items()]


def changes_text(changes: Mapping[str, Any], paths: Iterable[str]) -> str:
    """Return the changes in one line, with the shortest ends of `paths` that tell them apart."""
    names = _short_names(paths)
    texts = (f"{names[path]} {value_text(value)}" for path, value in changes.items())
    return ", ".join(texts) or TODAY


def value_text(value: object) -> str:
    """Return a value as a user writes it."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)


def _short_names(paths: Iterable[str]) -> dict[str, str]:
    steps = {path: parse_path(path) for path in paths}
    names = {}
    for path, own in steps.items():
        length = 1
        while sum(own[-length:] == other[-length:] for other in steps.values()) > 1:
            length += 1
        names[path] = format_path(own[-length:])
    return names
