"""The specs that a gate compares: those of the base, as git lists them, and new specs of the head.

Every spec that the base has under the gated paths has to be in the work tree of the head at the
same path, as a regular file. No link is followed, neither to a file nor to a folder above it, and
no spec is taken from a repository in the repository: each of these would let a change choose its
base. A deleted spec is a weaker gate, unless the pipeline allows it by name.

A spec that the base lacks is new, and judged alone. Where the base has specs, anywhere, that the
head lacks, it may be one of them under another name, so they have to be allowed first. Then a new
spec is compared with the one that has the same ``name:``.

Where the head lacks commits of the base, specs that these bring under the gated paths count, too:
a head that left early is not asked for less.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from r2bspec.compare.base_tree import BaseTree
from r2bspec.compare.gate_rules import GateChange
from r2bspec.diagnostics.diagnostic import Span
from r2bspec.diagnostics.quote import clip, printable
from r2bspec.errors import UsageError
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.safe_io.file_search import near_path

SPEC_SUFFIX = ".r2b.yaml"


class GatedPathError(UsageError):
    """A path that cannot be gated."""

    code = "R2B694"
    way_out = "Name specs, or folders of specs, of the repository of the working folder."


@dataclass(frozen=True)
class GatedSpec:
    """A spec of the head.

    Attributes:
        head: the file, relative to the working folder.
        place: its path below the top of the work tree.
        base: the path of the base's spec below the top of its tree; empty for a new spec.
    """

    head: Path
    place: str
    base: str


@dataclass(frozen=True)
class GatedSpecs:
    """The specs under the gated paths.

    Attributes:
        specs: the specs of the head, sorted by path.
        gone: specs and cases of the base that the head lacks.
        notes: what is not gated, a sentence each.
    """

    specs: tuple[GatedSpec, ...]
    gone: tuple[GateChange, ...]
    notes: tuple[str, ...]


def select_specs(tree: BaseTree, paths: Sequence[str]) -> GatedSpecs:
    """Return the specs under some paths.

    Args:
        tree: the tree of the base.
        paths: files and folders of the head's work tree.

    Raises:
        GatedPathError: a path has no spec, in the head or in the base, is in another repository,
            or cannot be read.
    """
    base: dict[str, None] = {}
    head: dict[str, None] = {}
    notes: list[str] = []
    for path in paths:
        place = _place(tree, path)
        before = [*_specs_of(tree.files, place)]
        after = [*_head_specs(tree, place, notes)]
        if place.endswith(".json"):
            raise GatedPathError(f"{clip(path)!r} is a plan: a gate compares specs")
        if not before and not after:
            what = f"has no *{SPEC_SUFFIX} file" if os.path.isdir(path) else "does not exist"  # noqa: PTH112
            hint = "" if os.path.isdir(path) else near_path(path)  # noqa: PTH112
            raise GatedPathError(
                f"{clip(path)!r} {what}, in the work tree or in {tree.name}", hint=hint
            )
        base |= dict.fromkeys(before)
        head |= dict.fromkeys(after)
    new = [place for place in head if place not in tree.files]
    if new:
        # One of those that are gone may be the new one, under another name.
        base |= dict.fromkeys(path for path in tree.files if path.endswith(SPEC_SUFFIX))
    missing = {path: why for path in base if (why := _obstacle(tree.head_top, path))}
    names = {_name(tree.top / path): path for path in missing} if new else {}
    names.pop("", None)
    specs = []
    for place in sorted(head):
        file = tree.head_top / place
        before_path = place if place in tree.files else names.get(_name(file), "")
        specs.append(GatedSpec(Path(os.path.relpath(file)), place, before_path))
    gone = [_gone(path, why) for path, why in sorted(missing.items())]
    gone += _later_specs(tree, paths)
    for spec in specs:
        gone += _gone_cases(tree, spec)
    return GatedSpecs(tuple(specs), tuple(gone), tuple(dict.fromkeys(notes)))


def _place(tree: BaseTree, path: str) -> str:
    """Return a path as git names it, without following any link."""
    place = Path(os.path.abspath(path))  # noqa: PTH100 - resolve would follow links
    if not place.is_relative_to(tree.head_top):
        raise GatedPathError(
            f"{clip(path)!r} is not in {tree.head_top}, the work tree of the working folder",
            hint="Name specs below the working folder's repository, through no link.",
        )
    below = place.relative_to(tree.head_top).as_posix()
    folder = below if place.is_dir() else PurePosixPath(below).parent.as_posix()
    if (why := _obstacle(tree.head_top, f"{folder}/x", parents=True)) and below not in tree.files:
        raise GatedPathError(f"{clip(path)!r} cannot be gated: {why}")
    return below


def _later_specs(tree: BaseTree, paths: Sequence[str]) -> Iterator[GateChange]:
    """Yield the specs that the base has since the head left, and that the head lacks."""
    places = {_place(tree, path) for path in paths}
    later = {spec for place in places for spec in _specs_of(tree.newer, place)} - tree.files.keys()
    for path in sorted(filter(tree.has_newer, later)):
        yield GateChange.of_tip(f"spec {printable(path)}", path, tree.tip, "not in HEAD")


def _specs_of(files: Iterable[str], place: str) -> Iterator[str]:
    """Yield those of the files of a tree that are the specs at a place."""
    start = "" if place == "." else f"{place}/"
    for path in files:
        hidden = any(part.startswith(".") for part in path.removeprefix(start).split("/"))
        if path == place or (path.startswith(start) and path.endswith(SPEC_SUFFIX) and not hidden):
            yield path


def _head_specs(tree: BaseTree, place: str, notes: list[str]) -> Iterator[str]:
    """Yield the specs in a folder of the head, or the one that is named."""
    start = tree.head_top / place
    mode = _mode(start)
    if stat.S_ISREG(mode):
        yield place
    waiting = [(start, "")] if stat.S_ISDIR(mode) else []
    while waiting:
        folder, other = waiting.pop()
        if folder != tree.head_top and os.path.lexists(folder / ".git"):
            other = str(folder.relative_to(tree.head_top))
        try:
            entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
        except OSError as error:
            raise GatedPathError(f"{folder} cannot be searched: {error.strerror}") from error
        for entry in entries:
            if entry.name.startswith("."):
                continue
            below = Path(entry.path).relative_to(tree.head_top).as_posix()
            if entry.is_dir(follow_symlinks=False):
                waiting.append((Path(entry.path), other))
            elif not entry.name.endswith(SPEC_SUFFIX):
                continue
            elif other:
                raise GatedPathError(
                    f"{below} is in {other}, a repository of its own, whose history is not that "
                    f"of {tree.name}",
                    hint="Gate it in that repository.",
                )
            elif entry.is_file(follow_symlinks=False):
                yield below
            elif below not in tree.files:
                notes.append(f"Not gated: {clip(below)} is a link, or no regular file.")


def _obstacle(top: Path, path: str, *, parents: bool = False) -> str:
    """Return why a path is no regular file of the work tree; empty if it is.

    Args:
        top: the top of the work tree.
        path: below it.
        parents: look only at the folders above it.
    """
    here = top
    *folders, name = PurePosixPath(path).parts
    for folder in folders:
        here /= folder
        mode = _mode(here)
        if stat.S_ISLNK(mode):
            return f"{here.relative_to(top)} is a link"
        if not stat.S_ISDIR(mode):
            return "gone"
        if os.path.lexists(here / ".git"):
            return f"{here.relative_to(top)} is a repository of its own"
    if parents:
        return ""
    mode = _mode(here / name)
    if stat.S_ISREG(mode):
        return ""
    return "a link" if stat.S_ISLNK(mode) else "no regular file" if mode else "gone"


def _mode(path: Path) -> int:
    """Return the mode of a path itself; 0 if there is nothing, or nothing that can be seen."""
    try:
        return path.lstat().st_mode
    except (OSError, ValueError):
        return 0


def _name(spec: Path) -> str:
    loaded = SpecSelection(spec, allow_paths=(spec.parent,)).load_cases()[0].spec
    return loaded.name if loaded is not None else ""


def _gone(path: str, why: str) -> GateChange:
    after = "" if why == "gone" else why
    return GateChange(
        f"spec {printable(path)}", (), after and "a regular file", after, Span.of_file(path)
    )


def _gone_cases(tree: BaseTree, spec: GatedSpec) -> Iterator[GateChange]:
    """Yield the cases that the base has and the head lacks."""
    if not spec.base:
        return
    before, after = (
        SpecSelection(file, allow_paths=(top,)).load_cases()
        for file, top in ((tree.top / spec.base, tree.top), (spec.head, tree.head_top))
    )
    left = {case.case for case in after}
    for case in before:
        if case.case and case.case not in left:
            name = case.spec.name if case.spec is not None else spec.base
            span = Span.of_file(str(spec.head))
            yield GateChange(f"case {name}[{case.case}]", ("matrix",), "", "", span)
