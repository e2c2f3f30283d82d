"""Mutants that nobody can call a mistake: they are specs that somebody may have wanted.

Each reason says why the mutant is as good a spec as the one it was made from. A mutant without a
finding, with another plan and without a reason here is a gap in the rules.
"""

from __future__ import annotations

from collections.abc import Callable

from mutants import Mutant

from r2bspec.diagnostics import Path
from r2bspec.language.declaration import rule_at

_NAMED = {
    ("slos",): "an objective",
    ("monitors",): "a monitor",
    ("preprocessors",): "a preprocessor",
    ("graph", "nodes"): "a node",
    ("containers",): "a container",
    ("setup",): "a step",
    ("ready",): "a probe",
    ("after_ready",): "a step",
    ("labels",): "a label",
    ("variables",): "a variable",
}
_WORDS = ("title", "description")


def reason(mutant: Mutant) -> str:
    """Why a mutant with another plan and no finding is no mistake, or an empty string."""
    return next((why for rule in _RULES if (why := rule(mutant))), "")


def _free_name(mutant: Mutant) -> str:
    what = _NAMED.get(_strings(mutant.path[:-1]), "")
    if mutant.kind == "misspell" and what:
        return f"the name of {what} is free, and nothing else in the spec uses it"
    if mutant.kind == "swap" and what:
        return f"the names are free, and nothing else in the spec uses them: {what} has another"
    return ""


def _words(mutant: Mutant) -> str:
    if mutant.path and mutant.path[-1] in _WORDS:
        return "words for readers; the language cannot judge them"
    return ""


def _label(mutant: Mutant) -> str:
    if mutant.kind == "retype" and mutant.path[:1] == ("labels",):
        return "a label may be of any type"
    return ""


def _entry_gone(mutant: Mutant) -> str:
    what = _NAMED.get(_strings(mutant.path[:-1]), "")
    if mutant.kind == "delete" and what:
        return f"a spec without {what} of that name is complete, and nothing refers to it"
    return ""


def _has_default(mutant: Mutant) -> str:
    owner = rule_at(mutant.path[:-1])
    optional = set() if owner is None else {*(owner.keys or ())} - {*owner.required}
    if mutant.kind == "delete" and mutant.path[-1] in optional:
        return "the key is optional, and its default applies"
    return ""


def _parameter(mutant: Mutant) -> str:
    if "parameters" not in mutant.path[:-1]:
        return ""
    if mutant.kind == "retype" and "instead" in mutant.note:
        return "the value came from a variable of the same type, which other nodes still use"
    if mutant.kind == "delete":
        return "the node has a default for the parameter"
    if mutant.kind == "swap":
        return "both parameters are of one type, and only the node knows which value is which"
    return ""


def _variables(mutant: Mutant) -> str:
    if mutant.kind == "swap" and mutant.path[:1] == ("variables",):
        return "both variables are of one type"
    return ""


def _interface(mutant: Mutant) -> str:
    if mutant.kind == "delete" and mutant.path[-2:-1] in (("publishes",), ("subscribes",)):
        return "of a node that states less, the rest is unknown, and not guessed"
    return ""


_RULES: tuple[Callable[[Mutant], str], ...] = (
    _words,
    _label,
    _variables,
    _free_name,
    _entry_gone,
    _has_default,
    _parameter,
    _interface,
)


def _strings(path: Path) -> tuple[str, ...]:
    return tuple(str(part) for part in path)
