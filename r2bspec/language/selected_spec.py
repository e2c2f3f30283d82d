"""The selection of a spec: its file, values from outside, its case, and allowed folders."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec

Variables = Mapping[str, bool | int | float | str]


class SelectionValues(TypedDict, total=False):
    """The fields of `SpecSelection` other than the file, as keyword arguments."""

    sets: Sequence[str]
    variables: Variables | None
    case: str
    allow_paths: Iterable[Path]


class LoadOptions(SelectionValues, total=False):
    """The options that, besides the text, determine the content of a spec.

    Attributes:
        file: the name of a text; its folder is that of the spec.
        environ: the environment for ``$(env X)``; that of this process by default.
    """

    file: str
    environ: Mapping[str, str] | None


@dataclass(frozen=True)
class SpecSelection:
    """A spec, with everything from outside that determines its content.

    Attributes:
        spec: the file; or a plan, where a plan is taken.
        sets: values to replace, each as ``path=value``.
        variables: values for declared variables.
        case: the case of its matrix, where the spec has several.
        allow_paths: folders, besides that of the spec, from which files may be extended, and in
            which the spec itself may be if it is a link.
    """

    spec: Path
    sets: Sequence[str] = ()
    variables: Variables | None = field(default_factory=dict)
    case: str = ""
    allow_paths: Iterable[Path] = ()

    def load(self) -> LoadedSpec:
        """Return the spec, or its selected case, with all problems in `diagnostics`."""
        from r2bspec.language.load_spec import load_spec

        return load_spec(self.spec, **self._values())

    def load_cases(self) -> tuple[LoadedSpec, ...]:
        """Return every case of the spec, or the selected case."""
        from r2bspec.language.load_spec import load_cases

        return load_cases(self.spec, **self._values())

    def _values(self) -> SelectionValues:
        return SelectionValues(
            sets=self.sets,
            variables=self.variables,
            case=self.case,
            allow_paths=self.allow_paths,
        )


def select(spec: SpecSelection | Path | str, values: SelectionValues) -> SpecSelection:
    """Return a selection from a path, or from another selection with some fields replaced."""
    if isinstance(spec, SpecSelection):
        return replace(spec, **values)
    return SpecSelection(Path(spec), **values)
