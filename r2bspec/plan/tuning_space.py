"""The deployments of a graph: its levers, the settings of each, and one choice of them.

A lever is a key of the spec, or a few that belong together, that changes how the graph is deployed
and not what it computes. A setting is a list of assignments as ``--set`` takes them, so that a
deployment is compiled and checked by the same code as every spec.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import msgspec

from r2bspec.diagnostics.diagnostic import Path, format_path
from r2bspec.language.yaml_document import parse_unquoted


def value_text(value: object) -> str:
    """A value as a user reads it."""
    if isinstance(value, str):
        return value
    if isinstance(value, bool | int | float | list | tuple | dict) or value is None:
        return json.dumps(value, ensure_ascii=False, default=str)
    return str(value)


def assignment(path: Path, value: object) -> str:
    """The assignment of a value as ``--set`` takes it."""
    text = value_text(value)
    if isinstance(value, str) and (text[:1] in "[{'\"" or parse_unquoted(text) != value):
        text = json.dumps(value, ensure_ascii=False)
    return f"{format_path(path)}={text}"


class Setting(msgspec.Struct, frozen=True, kw_only=True):
    """One value of a lever.

    Attributes:
        text: the value as users read it: ``shared``, ``4 threads``.
        sets: assignments, each ``path=value``; empty for what the spec has today.
        for_others: what it changes for other programs of the machine, in a sentence; else empty.
    """

    text: str
    sets: tuple[str, ...] = ()
    for_others: str = ""


class Lever(msgspec.Struct, frozen=True, kw_only=True):
    """One thing that can be deployed in several ways.

    Attributes:
        name: the path of its key: ``graph.placement``, ``graph.nodes.detector.threads``.
        settings: at least two; the first is today's.
        only_with: the settings of another lever with which it has an effect, by their places: a
            node that shares a process has no executor of its own. Empty for every setting.
    """

    name: str
    settings: tuple[Setting, ...]
    only_with: dict[str, tuple[int, ...]] = {}

    @classmethod
    def of(cls, name: str, today: str, others: Iterable[Setting], **rest: Any) -> Lever:
        """A lever by the text of today's setting, and others, which may have that one, too."""
        settings = (Setting(text=today), *(each for each in others if each.text != today))
        return cls(name=name, settings=settings, **rest)

    def applies(self, choice: Mapping[str, int]) -> bool:
        """Whether it has an effect with a choice of other levers."""
        return all(choice.get(name, 0) in places for name, places in self.only_with.items())


class TuningSpace(msgspec.Struct, frozen=True, kw_only=True):
    """All deployments of a graph that a search may try.

    Attributes:
        levers: by their names, in the order of the spec.
        left_out: what was not made a lever, and why, a sentence each.
    """

    levers: tuple[Lever, ...]
    left_out: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        """The number of different deployments, today's among them."""
        parents = {name for lever in self.levers for name in lever.only_with}
        deciding = [lever for lever in self.levers if lever.name in parents]
        others = [lever for lever in self.levers if lever.name not in parents]
        places = itertools.product(*(range(len(lever.settings)) for lever in deciding))
        choices = [
            dict(zip((lever.name for lever in deciding), each, strict=True)) for each in places
        ]
        return sum(
            math.prod(len(lever.settings) for lever in others if lever.applies(choice))
            for choice in choices
            if all(lever.applies(choice) or not choice[lever.name] for lever in deciding)
        )

    def today(self) -> Deployment:
        """The deployment of the spec as it is."""
        return Deployment()

    def deployment(self, choice: Mapping[str, int]) -> Deployment:
        """The deployment of a choice, without levers that have no effect with it.

        Args:
            choice: places of settings by the names of levers; today's where a lever has none.

        Raises:
            KeyError: there is no such lever.
            IndexError: it has no such setting.
        """
        places = {lever.name: lever for lever in self.levers}
        for name, place in choice.items():
            if not 0 <= place < len(places[name].settings):
                raise IndexError(f"{name} has no setting {place}")
        return Deployment(
            choices=tuple(
                Choice(lever=lever.name, place=place, setting=lever.settings[place])
                for lever in self.levers
                if (place := choice.get(lever.name, 0)) and lever.applies(choice)
            )
        )


class Choice(msgspec.Struct, frozen=True, kw_only=True):
    """A setting of a lever that is not today's; `place` is its place among the settings."""

    lever: str
    place: int
    setting: Setting


class Deployment(msgspec.Struct, frozen=True):
    """One way to deploy a graph.

    Attributes:
        choices: what differs from today, in the order of the levers; empty for today's.
    """

    choices: tuple[Choice, ...] = ()

    @property
    def sets(self) -> tuple[str, ...]:
        """Assignments for ``--set`` that make the spec this deployment."""
        return tuple(value for choice in self.choices for value in choice.setting.sets)

    @property
    def text(self) -> str:
        """What differs from today, in one line."""
        return ", ".join(f"{each.lever}: {each.setting.text}" for each in self.choices) or "today's"

    def for_others(self) -> Iterator[str]:
        """What it changes for other programs of the machine, a sentence each."""
        return (each.setting.for_others for each in self.choices if each.setting.for_others)
