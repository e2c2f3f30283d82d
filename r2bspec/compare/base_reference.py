"""The base of ``--against``: another spec, or the same spec with other settings.

    SPEC                another spec, or a plan written by 'r2bspec plan'
    var:NAME=VALUE      the same spec with another value of a declared variable
    set:PATH=VALUE      the same spec with another value anywhere
    env:FILE            another workspace: its setup file, the folder of its installation,
    env:FOLDER          or a single variable of the environment
    env:NAME=VALUE

Several are combined: a spec and its variables, in an environment.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from r2bspec.errors import UsageError
from r2bspec.language.secrets import shown_value
from r2bspec.safe_io.file_search import near_path
from r2bspec.safe_io.safe_file import is_regular, is_there

HINT = (
    "Give a spec, var:NAME=VALUE, set:PATH=VALUE, or env: with a setup file, an installed "
    "workspace or NAME=VALUE. The gate of a revision is 'r2bspec gate SPEC --base REVISION'."
)


class BadReferenceError(UsageError):
    """The argument of ``--against`` is not a base."""

    code = "R2B656"


@dataclass(frozen=True)
class BaseReference:
    """The base of a comparison, as given on the command line.

    Attributes:
        text: the arguments, joined, without the values of secrets.
        spec: another spec or plan; None for that of the head.
        variables: values of variables that differ from the head's.
        sets: values that differ from the head's, each as ``path=value``.
        environments: read by `r2bspec.execute.processes.environment.workspace`, in order.
    """

    text: str
    spec: Path | None = None
    variables: Mapping[str, str] = field(default_factory=dict)
    sets: tuple[str, ...] = ()
    environments: tuple[str, ...] = ()

    @property
    def changes_spec(self) -> bool:
        """Whether the base has another spec, or other values, and not only an environment."""
        return bool(self.spec or self.variables or self.sets)


def parse_base_reference(texts: Sequence[str]) -> BaseReference:
    """Parse the arguments of ``--against``.

    Raises:
        BadReferenceError: an argument is malformed, or a second spec, or does not exist.
    """
    specs: list[Path] = []
    variables: dict[str, str] = {}
    sets: list[str] = []
    environments: list[str] = []
    for text in texts:
        kind, colon, rest = text.partition(":")
        if colon and kind in {"var", "set"}:
            name, equals, value = rest.partition("=")
            if not equals or not name:
                raise BadReferenceError(f"{kind}: takes NAME=VALUE, not {rest!r}", hint=HINT)
            if kind == "var":
                variables[name] = value
            else:
                sets.append(rest)
        elif colon and kind == "env":
            environments.append(rest)
        else:
            specs.append(_spec(text))
    if len(specs) > 1:
        raise BadReferenceError(
            f"only one base is possible: {specs[0]} or {specs[1]}",
            hint="Compare with each of them in a run of its own.",
        )
    return BaseReference(
        text=", ".join(map(_shown, texts)),
        spec=next(iter(specs), None),
        variables=variables,
        sets=tuple(sets),
        environments=tuple(environments),
    )


def _spec(text: str) -> Path:
    path = Path(text)
    if text and is_regular(path):
        return path
    if is_there(path / "record.json") or is_there(path / "pairs.json"):
        raise BadReferenceError(
            f"{text!r} is a stored run: it cannot be a base",
            hint="A stored run cannot be played again; 'r2bspec compare' compares finished runs.",
        )
    raise BadReferenceError(
        f"{text!r} is not a spec: it cannot be a base", hint=near_path(text) or HINT
    )


def _shown(text: str) -> str:
    """Return a reference as it may be shown: of a secret, without its value."""
    name, equals, value = text.removeprefix("env:").partition("=")
    return f"env:{name}={shown_value(name, value)}" if text.startswith("env:") and equals else text
