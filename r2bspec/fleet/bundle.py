"""What of a spec's files a run on another machine needs: only what its plan names.

Every path of a plan is relative to the folder of its spec. A bundle keeps these relations: its root
is the lowest folder that has all of them, and all that they go through, so that
``../config/x.yaml`` and ``../specs/bag`` are found on a host as they are here. The digest of a
bundle covers the paths, the contents and the executable bits.
"""

from __future__ import annotations

import ast
import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec

from r2bspec.bags.digest import hash_files
from r2bspec.errors import UsageError
from r2bspec.fleet.host_messages import SentFile, SentRecording, Side
from r2bspec.language.quantities import Size
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.plan import DatasetPlan, Plan

MAX_BUNDLE_BYTES: Final = 512 << 20
"""A folder that a command names may be a whole workspace, which belongs on the host."""

_MAX_FILES: Final = 20_000
_MAX_SOURCE_BYTES: Final = 1_000_000
_BLOCK_BYTES: Final = 1 << 20


class BundleTooLargeError(UsageError):
    """The files of a spec are too many to be sent with it."""

    code = "R2B686"


@dataclass(frozen=True)
class SentSide:
    """A benchmark to be sent: its plan, its folder, and its resolved spec (empty for a plan)."""

    plan: Plan
    base_dir: Path
    spec_text: str


@dataclass(frozen=True)
class Bundle:
    """What travels of one or two benchmarks.

    Attributes:
        digest: of `files`, in hexadecimal digits.
        sides: the benchmarks, with folders relative to the root.
        sources: where each content is on this machine, by digest.
        recordings: those that hosts do not make themselves.
        recording_sources: where the files of each are, by its digest.
    """

    digest: str
    files: tuple[SentFile, ...]
    sides: tuple[Side, ...]
    sources: dict[str, Path]
    recordings: tuple[SentRecording, ...]
    recording_sources: dict[str, Path]


def make_bundle(sides: Sequence[SentSide]) -> Bundle:
    """Collect what the plans name.

    Raises:
        BundleTooLargeError: it is more than hosts take.
        DataError: a recording does not exist or cannot be read.
    """
    named = [(side, sorted(set(named_files(side)))) for side in sides]
    recordings = [found for side in sides for found in _recordings(side)]
    places = [str(_absolute(side.base_dir)) for side in sides]
    places += [str(each.parent) for _, files in named for each in files]
    places += [str(each.top) for each in recordings if not each.absolute]
    places += [str(each) for side in sides for each in _tops(side)]
    root = Path(os.path.commonpath(places))
    files, sources = _described(root, (each for _, found in named for each in found))
    text = msgspec.json.encode(files)
    sent, recording_sources = _sent_recordings(root, recordings)
    return Bundle(
        digest=hashlib.sha256(text).hexdigest(),
        files=files,
        sides=tuple(
            Side(
                plan=canonical_json(side.plan).decode(),
                spec_text=side.spec_text,
                base_dir=os.path.relpath(_absolute(side.base_dir), root),
            )
            for side in sides
        ),
        sources=sources,
        recordings=sent,
        recording_sources=recording_sources,
    )


def named_files(side: SentSide) -> Iterator[Path]:
    """Every file that a plan names, and what Python files of it import from their own folders."""
    base_dir = _absolute(side.base_dir)
    for word in _all_words(side.plan):
        yield from _files_at(base_dir, word)
    for process in side.plan.processes:
        for node in process.nodes:
            record = base_dir / "interfaces" / f"{node.node}.yaml"
            if record.is_file():
                yield record


def _tops(side: SentSide) -> Iterator[Path]:
    """The highest folders that the paths of a plan go through, where they name files."""
    base_dir = _absolute(side.base_dir)
    for word in _all_words(side.plan):
        if ".." in word and next(_files_at(base_dir, word), None) is not None:
            yield _top(base_dir, word)


def _top(base_dir: Path, path: str) -> Path:
    """The highest folder that a relative path goes through: of ``../x/y``, the parent."""
    depth = lowest = 0
    for part in Path(path).parts:
        depth += -1 if part == ".." else 1
        lowest = min(lowest, depth)
    above = (base_dir, *base_dir.parents)
    return above[min(-lowest, len(above) - 1)]


def needs_of(plan: Plan, bundle: str) -> str:
    """Identifies what a plan needs of a host: plans with the same needs run there or do not.

    Rates, durations, objectives and titles were checked where the plan was made.
    """
    found = [
        *(bundle, plan.requires or None, plan.environment, plan.transport, plan.segment_bytes),
        *(plan.datasets or plan.dataset, plan.topics, _parts(plan)),
    ]
    return hashlib.sha256(msgspec.json.encode(found, enc_hook=str)).hexdigest()


def _parts(plan: Plan) -> list[Any]:
    """What a run starts, loads and calls; topics and labels name no files."""
    return [
        [[each.argv, each.env, each.nodes] for each in plan.processes],
        plan.setup,
        plan.after_ready,
        plan.harness,
    ]


def _all_words(plan: Plan) -> Iterator[str]:
    for text in _texts(msgspec.to_builtins(_parts(plan))):
        yield from _words(text)


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for each in value.values():
            yield from _texts(each)
    elif isinstance(value, list | tuple):
        for each in value:
            yield from _texts(each)


def _words(text: str) -> Iterator[str]:
    """A text, and the path in ``./node.py:Class``, ``file:=x.launch.py`` and ``NAME=x.yaml``."""
    yield text
    _, assigned, value = text.partition(":=")
    if assigned:
        yield value
        return
    if ":" in text:
        yield text.rpartition(":")[0]
    if "=" in text:
        yield text.partition("=")[2]


def _files_at(base_dir: Path, word: str) -> Iterator[Path]:
    if not word or len(word) > 4000 or "\0" in word or "\n" in word or word[0] in "/~":
        return
    place = Path(os.path.normpath(base_dir / word))
    if place in (base_dir, *base_dir.parents):
        return
    try:
        if place.is_dir():
            # A word such as a name of a topic is no path, even if a folder has that name.
            if "/" in word:
                yield from _files_below(place)
        elif place.is_file():
            yield place
            if place.suffix == ".py":
                yield from _imported(place)
    except OSError:
        return


def _files_below(folder: Path) -> Iterator[Path]:
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__pycache__")))
        yield from (Path(parent, name) for name in sorted(files))


def _imported(file: Path) -> Iterator[Path]:
    """The modules in the folder of a Python file that it imports, directly or indirectly."""
    seen = {file}
    pending = [file]
    while pending:
        source = pending.pop()
        for name in _imported_names(source):
            package = file.parent / name
            found = [package.with_suffix(".py")] if package.with_suffix(".py").is_file() else []
            if not found and (package / "__init__.py").is_file():
                found = list(_files_below(package))
            for each in found:
                if each not in seen:
                    seen.add(each)
                    yield each
                    if each.suffix == ".py":
                        pending.append(each)


def _imported_names(file: Path) -> set[str]:
    try:
        if file.stat().st_size > _MAX_SOURCE_BYTES:
            return set()
        tree = ast.parse(file.read_bytes())
    except (OSError, SyntaxError, ValueError, RecursionError, MemoryError):
        return set()
    names: set[str] = set()
    for each in ast.walk(tree):
        if isinstance(each, ast.Import):
            names.update(alias.name.partition(".")[0] for alias in each.names)
        elif isinstance(each, ast.ImportFrom) and each.module and not each.level:
            names.add(each.module.partition(".")[0])
    return names


def _described(root: Path, files: Iterable[Path]) -> tuple[tuple[SentFile, ...], dict[str, Path]]:
    described: list[SentFile] = []
    sources: dict[str, Path] = {}
    total = 0
    for file in sorted(set(files)):
        sha256, size = digest_of(file)
        total += size
        if total > MAX_BUNDLE_BYTES or len(described) == _MAX_FILES:
            raise BundleTooLargeError(
                f"the files that the spec names have more than {Size(MAX_BUNDLE_BYTES)} or are "
                f"more than {_MAX_FILES:,}, up to {file}",
                hint="Install large parts on the hosts, and name them there.",
            )
        executable = os.access(file, os.X_OK)
        path = file.relative_to(root).as_posix()
        described.append(SentFile(path=path, size=size, sha256=sha256, executable=executable))
        sources[sha256] = file
    return tuple(described), sources


def digest_of(file: Path) -> tuple[str, int]:
    """The SHA-256 of a file, and its size in bytes."""
    content = hashlib.sha256()
    size = 0
    with file.open("rb") as stream:
        while block := stream.read(_BLOCK_BYTES):
            content.update(block)
            size += len(block)
    return content.hexdigest(), size


@dataclass(frozen=True)
class _Recording:
    """A recording that a plan names: where its run looks for it, and where it is here.

    Attributes:
        top: the lowest folder that has both it and all that its path goes through.
    """

    at: Path
    source: Path
    absolute: bool
    top: Path


def _recordings(side: SentSide) -> Iterator[_Recording]:
    """The recordings of a plan; hosts make synthetic ones themselves."""
    from r2bspec.datasets.locate_bag import locate

    datasets: tuple[DatasetPlan, ...] = side.plan.datasets or (side.plan.dataset,)
    for each in datasets:
        location = locate(each.source, side.base_dir) if each.source else None
        if location is None or location.path is None:
            continue
        at = Path(os.path.expanduser(each.source))  # noqa: PTH111
        absolute = at.is_absolute()
        at = _absolute(side.base_dir / at)
        ways = (at.parent, _top(_absolute(side.base_dir), each.source))
        top = Path(os.path.commonpath(ways))
        yield _Recording(at, location.path, absolute, top)


def _sent_recordings(
    root: Path, found: Iterable[_Recording]
) -> tuple[tuple[SentRecording, ...], dict[str, Path]]:
    sent: dict[str, SentRecording] = {}
    sources: dict[str, Path] = {}
    for each in found:
        digest = hash_files(each.source)
        path = str(each.at) if each.absolute else each.at.relative_to(root).as_posix()
        sent[path] = SentRecording(
            path=path,
            sha256=digest,
            files=_files_of(each.source),
            folder=each.source.is_dir(),
        )
        sources[digest] = each.source
    return tuple(sent.values()), sources


def _absolute(path: Path) -> Path:
    """The path without ``..``; links stay, because plans name what is behind them so."""
    return Path(os.path.normpath(path.absolute()))


def _files_of(bag: Path) -> tuple[SentFile, ...]:
    if not bag.is_dir():
        return (_sent(bag, bag.name),)
    inside = sorted(each for each in bag.rglob("*") if each.is_file())
    return tuple(_sent(each, each.relative_to(bag).as_posix()) for each in inside)


def _sent(file: Path, path: str) -> SentFile:
    sha256, size = digest_of(file)
    return SentFile(path=path, size=size, sha256=sha256)
