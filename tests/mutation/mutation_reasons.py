"""Mutants that nobody can call a mistake: they are specs that somebody may have wanted.

Each reason says why the mutant is as good a spec as the one it was made from. A mutant without a
finding, with another plan and without a reason here is a gap in the rules.
"""

from __future__ import annotations

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
    kind, path = mutant.kind, mutant.path
    what = _NAMED.get(tuple(map(str, path[:-1])), "")
    if path and path[-1] in _WORDS:
        return "words for readers; the language cannot judge them"
    match kind, path[:1]:
        case "retype", ("labels",):
            return "a label may be of any type"
        case "swap", ("variables",):
            return "both variables are of one type"
    match kind:
        case "misspell" if what:
            return f"the name of {what} is free, and nothing else in the spec uses it"
        case "swap" if what:
            used = "the names are free, and nothing else in the spec uses them"
            return f"{used}: {what} has another"
        case "delete" if what:
            return f"a spec without {what} of that name is complete, and nothing refers to it"
        case "delete" if path[-1] in _optional_keys(path[:-1]):
            return "the key is optional, and its default applies"
    if "parameters" in path[:-1]:
        return _of_parameter(mutant)
    if kind == "delete" and path[-2:-1] in (("publishes",), ("subscribes",)):
        return "of a node that states less, the rest is unknown, and not guessed"
    return ""


def _optional_keys(path: Path) -> set[str]:
    owner = rule_at(path)
    return set() if owner is None else {*(owner.keys or ())} - {*owner.required}


def _of_parameter(mutant: Mutant) -> str:
    if mutant.kind == "retype" and "instead" in mutant.note:
        return "the value came from a variable of the same type, which other nodes still use"
    if mutant.kind == "delete":
        return "the node has a default for the parameter"
    if mutant.kind == "swap":
        return "both parameters are of one type, and only the node knows which value is which"
    return ""
