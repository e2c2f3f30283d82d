"""The text of a spec with a deployment written into it.

The document that is wanted is the one that ``--set`` makes of the text. The text is changed key by
key until it is read as that document: a value is replaced, a key removed or added where the
language has it, in the style of what surrounds it. Every other byte is kept, which a round trip
through a YAML writer does for the writer's own indentation only. What the file has from a file, an
entry or a map that it extends is added to the entry itself, where it has precedence.

Where that is not possible, because a value is shared by an alias or comes from a variable, a second
file extends the spec and has the changed keys alone: the same change of a text that has nothing yet
but ``extends``.
"""

from __future__ import annotations

import json
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.diagnostics import Path as KeyPath
from r2bspec.diagnostics import Severity
from r2bspec.diagnostics.edits import unified_diff
from r2bspec.errors import UsageError
from r2bspec.language.load_spec import LoadedSpec, load_cases, open_document
from r2bspec.language.located_tree import ListNode, MapNode, ScalarNode, TreeNode, UnknownNode
from r2bspec.language.selected_spec import LoadOptions, SpecSelection
from r2bspec.language.variables import assigned_path, paths_overlap
from r2bspec.safe_io import safe_file
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES
from r2bspec.tune.yaml_edit import scalar_text, with_value

OVERLAY_SUFFIX: Final = ".tuned.r2b.yaml"

_MAX_CHANGES: Final = 500


class Patch(msgspec.Struct, frozen=True, kw_only=True):
    """A change of a file that makes a spec a deployment.

    Attributes:
        file: the spec, or a new file next to it.
        before: its text; empty if it is new.
        after: the text that it is to have.
        notes: what the reader has to know of it, a sentence each.
    """

    file: Path
    before: str
    after: str
    notes: tuple[str, ...] = ()

    @property
    def diff(self) -> str:
        """The change as a unified diff; empty if there is none."""
        return unified_diff(self.before, self.after, str(self.file))


def patch_spec(selection: SpecSelection, sets: Sequence[str]) -> Patch:
    """The change that does in a file what `sets` do on the command line.

    Args:
        selection: the spec; what decides besides its text what is in it stays outside of it.
        sets: assignments, each ``path=value``.

    Raises:
        UsageError: the file is not readable, the spec is not valid with `sets`, or neither the
            file nor one that extends it can say the same.
    """
    spec = selection.spec
    before = _read(spec)
    if before is None:
        raise UsageError(
            f"{spec} cannot be changed: it is a link elsewhere, or not readable",
            hint="Name the file itself, or give the values with --set.",
        )
    # What the deployment sets anew the file has to say itself.
    paths = [assigned_path(each) for each in sets]
    inside = [
        each
        for each in selection.sets
        if any(paths_overlap(assigned_path(each), path) for path in paths)
    ]
    beside = [each for each in selection.sets if each not in inside]
    around = [
        each for each in inside if not any(_is_in(assigned_path(each), path) for path in paths)
    ]
    outside = LoadOptions(
        file=str(spec),
        sets=beside,
        variables=selection.variables,
        allow_paths=selection.allow_paths,
        untrusted=selection.untrusted,
    )
    wanted = _Reading.of(before, outside | {"sets": (*selection.sets, *sets)})
    if any(case.spec is None for case in wanted.cases):
        found = (each for case in wanted.cases for each in case.diagnostics)
        wrong = next(each for each in found if each.severity is Severity.ERROR)
        raise UsageError(
            f"{spec} is not valid with {', '.join(sets)}: {wrong.message}",
            hint="'r2bspec validate' with the same --set values shows every finding.",
        )
    shared = (*_shared_by_cases(wanted.cases), *_given(around, beside, selection.variables or {}))
    after = _edited_until(before, wanted, outside)
    if after is not None:
        return Patch(file=spec, before=before, after=after, notes=shared)
    overlay = spec.with_name(spec.name.removesuffix(".yaml").removesuffix(".r2b") + OVERLAY_SUFFIX)
    start = (
        f"# A deployment of {json.dumps(spec.name)} that 'r2bspec tune' has found.\n"
        f"extends: {scalar_text(spec.name)}\n"
    )
    after = _edited_until(start, wanted, outside | {"file": str(overlay)})
    if after is None:
        raise UsageError(
            f"neither {spec} nor a file that extends it can have {', '.join(sets)}",
            hint="Change these keys by hand, or give them with --set.",
        )
    why = f"{spec} has values that are shared or come from variables: {overlay} extends it"
    return Patch(file=overlay, before=_read(overlay) or "", after=after, notes=(why, *shared))


def _read(file: Path) -> str | None:
    try:
        return safe_file.read_text(file, max_bytes=MAX_DOCUMENT_BYTES, folders=(file.parent,))
    except (OSError, ValueError):
        return None


def _shared_by_cases(cases: Sequence[LoadedSpec]) -> tuple[str, ...]:
    return (f"the change applies to all {len(cases)} cases of the matrix",) * (len(cases) > 1)


def _is_in(path: KeyPath, other: KeyPath) -> bool:
    return path[: len(other)] == other


def _given(
    around: Sequence[str], beside: Sequence[str], variables: Mapping[str, object]
) -> Iterator[str]:
    """What the search was given on the command line: what of it the change has, and what not."""
    words = [f"--set {shlex.quote(each)}" for each in beside]
    words += [f"--var {shlex.quote(f'{name}={value}')}" for name, value in variables.items()]
    if words:
        yield f"proved with {' '.join(words)}, which the change does not have"
    if around:
        yield f"the change has {' '.join(f'--set {shlex.quote(each)}' for each in around)}, too"


class _Reading(msgspec.Struct, frozen=True):
    """What a text says: its document before variables are known, and every case of it."""

    tree: TreeNode | None
    cases: tuple[LoadedSpec, ...]

    @classmethod
    def of(cls, text: str, options: LoadOptions) -> _Reading:
        return cls(open_document(text, options).tree, load_cases(text, **options))

    def says(self, other: _Reading) -> bool:
        """Whether all cases have the same values."""
        return [(case.case, case.spec) for case in self.cases] == [
            (case.case, case.spec) for case in other.cases
        ]


def _edited_until(text: str, wanted: _Reading, options: LoadOptions) -> str | None:
    """The text changed until it says what is wanted; None if it cannot."""
    seen = {text}
    while len(seen) < _MAX_CHANGES:
        difference = _difference(open_document(text, options).tree, wanted.tree, ())
        if difference is None:
            return text if _Reading.of(text, options).says(wanted) else None
        edited = with_value(text, *difference)
        if edited is None or edited in seen:
            return None
        text = edited
        seen.add(text)
    return None


def _difference(
    found: TreeNode | None, wanted: TreeNode | None, path: KeyPath
) -> tuple[KeyPath, TreeNode | None] | None:
    """The path of the first value that differs, and the value wanted there, if any."""
    if isinstance(found, MapNode) and isinstance(wanted, MapNode):
        for key, entry in wanted.entries.items():
            below = found.entries.get(key)
            if below is None:
                return (*path, key), entry.value
            difference = _difference(below.value, entry.value, (*path, key))
            if difference is not None:
                return difference
        extra = next((key for key in found.entries if key not in wanted.entries), None)
        return None if extra is None else ((*path, extra), None)
    return None if _is_same(found, wanted) else (path, wanted)


def _is_same(found: TreeNode | None, wanted: TreeNode | None) -> bool:
    if isinstance(found, ScalarNode) and isinstance(wanted, ScalarNode):
        # 1.0 is not 1, and the text counts where the language takes a number as it is written.
        if isinstance(found.value, str) or isinstance(wanted.value, str):
            return found.value == wanted.value
        return found.text == wanted.text
    if isinstance(found, ListNode) and isinstance(wanted, ListNode):
        pairs = zip(found.items, wanted.items, strict=False)
        return len(found.items) == len(wanted.items) and all(_is_same(*pair) for pair in pairs)
    if isinstance(found, MapNode) and isinstance(wanted, MapNode):
        return _difference(found, wanted, ()) is None
    return isinstance(found, UnknownNode) and isinstance(wanted, UnknownNode)
