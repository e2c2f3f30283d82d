"""The argument of ``--against``: the base of a comparison.

    REVISION            the same spec as a revision of git has it: a branch, a tag, a commit;
                        with three dots at its end, where the work tree branched off from it
    FOLDER              the same spec in another work tree
    SPEC                another spec, or a plan written by 'r2bspec plan'
    var:NAME=VALUE      the same spec with another value of a declared variable
    set:PATH=VALUE      the same spec with another value anywhere
    env:FILE            another workspace: its setup file, the folder of its installation,
    env:FOLDER          or a single variable of the environment
    env:NAME=VALUE

Several are combined: a spec and its variables, in an environment. Whether a revision exists is
asked of the repository that holds the spec, when the base is opened (`r2bspec.compare.base_tree`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from r2bspec.errors import UsageError
from r2bspec.language.secrets import shown_value
from r2bspec.safe_io.safe_file import is_folder, is_regular, is_there

HINT = (
    "Give a revision of git such as origin/main, another work tree, a spec, var:NAME=VALUE, "
    "set:PATH=VALUE, or env: with a setup file, an installed workspace or NAME=VALUE."
)

_SPEC_SUFFIXES = (".yaml", ".yml", ".json")


class BadReferenceError(UsageError):
    """The argument of ``--against`` is not a base."""

    code = "R2B656"


@dataclass(frozen=True)
class BaseReference:
    """The base of a comparison, as given on the command line.

    Attributes:
        text: the arguments, joined, without the values of secrets.
        revision: what git calls the base; empty for none.
        folder: another work tree; None for none.
        spec: another spec or plan; None for that of the head.
        variables: values of variables that differ from the head's.
        sets: values that differ from the head's, each as ``path=value``.
        environments: read by `r2bspec.execute.processes.environment.workspace`, in order.
    """

    text: str
    revision: str = ""
    folder: Path | None = None
    spec: Path | None = None
    variables: Mapping[str, str] = field(default_factory=dict)
    sets: tuple[str, ...] = ()
    environments: tuple[str, ...] = ()

    @property
    def changes_spec(self) -> bool:
        """Whether the base has another spec, or other values, and not only an environment."""
        return bool(self.spec or self.variables or self.sets or self.has_tree)

    @property
    def has_tree(self) -> bool:
        """Whether the base has a work tree of its own, with its spec and its code."""
        return bool(self.revision) or self.folder is not None


def parse_base_reference(texts: Sequence[str]) -> BaseReference:
    """Parse the arguments of ``--against``.

    Raises:
        BadReferenceError: an argument is malformed, or a second spec, or does not exist.
    """
    bases: list[str] = []
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
            bases.append(text)
    if len(bases) > 1:
        raise BadReferenceError(
            f"only one base is possible: {bases[0]} or {bases[1]}",
            hint="Compare with each of them in a run of its own.",
        )
    reference = BaseReference(
        text=", ".join(map(_shown, texts)),
        variables=variables,
        sets=tuple(sets),
        environments=tuple(environments),
    )
    return _with_base(reference, bases[0]) if bases else reference


def _with_base(reference: BaseReference, text: str) -> BaseReference:
    """A reference with a spec, a work tree, or what may be a revision."""
    path = Path(text)
    if text and is_regular(path):
        return replace(reference, spec=path)
    if is_there(path / "record.json") or is_there(path / "pairs.json"):
        raise BadReferenceError(
            f"{text!r} is a stored run: it cannot be a base",
            hint="A stored run cannot be played again; use --baseline for an advisory comparison.",
        )
    if text and is_folder(path):
        return replace(reference, folder=path)
    if not text or text.endswith(_SPEC_SUFFIXES):
        raise BadReferenceError(f"{text!r} does not exist: it cannot be a base", hint=HINT)
    return replace(reference, revision=text)


def _shown(text: str) -> str:
    """A reference as it may be shown: one that sets a secret, without its value."""
    name, equals, value = text.removeprefix("env:").partition("=")
    return f"env:{name}={shown_value(name, value)}" if text.startswith("env:") and equals else text
