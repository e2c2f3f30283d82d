"""The keys of a ``ROS2BenchmarkConfig``, and notes about those that are not understood."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from r2bspec.interop.script_import.benchmark_script import BenchmarkScript
from r2bspec.interop.script_import.evaluator import Note
from r2bspec.interop.script_import.script_values import Foreign, Unknown


@dataclass(frozen=True, slots=True)
class ScriptSettings:
    """The configuration of a script.

    Attributes:
        notes: is extended by what is left out.
    """

    script: BenchmarkScript
    notes: list[Note]

    def value(self, key: str, default: Any) -> Any:
        """A keyword argument of the configuration, or its default."""
        return self.script.config.get(key, default=default)

    def number(self, key: str, default: float) -> float:
        """A number; its default, with a note, for anything else."""
        value = self.value(key, default)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if is_number and math.isfinite(value):
            return float(value)
        self.lost(key, value)
        return default

    def flag(self, key: str) -> bool:
        """Whether a switch is on."""
        return self.value(key, False) is True

    def lost(self, key: str, value: Any) -> None:
        """Note that a key is left out."""
        reason = value.reason if isinstance(value, Unknown) else "its value is not understood"
        place = value.place if isinstance(value, Unknown) else self.script.config.place_of(key)
        self.notes.append(Note(f"{key!r} is left out: {reason}", place))

    def comments(self, key: str) -> list[str]:
        """The author's comments above a key."""
        place = self.script.config.place_of(key)
        is_given = key in self.script.config.keyword_places
        return self.script.comments.at(place.line) if is_given else []

    def mode(self) -> str:
        """The mode of playing, as a spec names it."""
        value = self.value("benchmark_mode", "LOOPING")
        name = value.name.rpartition(".")[2] if isinstance(value, Foreign) else value
        if isinstance(name, str) and name.lower() in {"timeline", "looping", "sweeping", "live"}:
            return name.lower()
        self.lost("benchmark_mode", value)
        return "looping"
