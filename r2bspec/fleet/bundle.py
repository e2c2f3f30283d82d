"""What of a spec's files a run on another machine needs: only what its plan names.

Every path of a plan is relative to the folder of its spec. A bundle keeps these relations: its root
is the lowest folder that has all of them, and all that they go through, so that
``../config/x.yaml`` and ``../specs/bag`` are found on a host as they are here. Files and recordings
travel by their digests, so that a host is sent nothing twice; the digest of a bundle covers the
paths, the contents and the executable bits.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import msgspec

from r2bspec.bags.integrity import hash_files
from r2bspec.execute.identity.python_sources import imports_of
from r2bspec.execute.processes.environment import texts
from r2bspec.fleet.errors import BundleTooLargeError
from r2bspec.language.quantities import Size
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.plan import Plan
from r2bspec.plan.prepared_benchmark import PreparedBenchmark
from r2bspec.safe_io import limits
from r2bspec.safe_io.file_search import regular_files, walk

Sha256 = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]
Identity = Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{32}\Z")]
Count = Annotated[int, msgspec.Meta(ge=0, le=1 << 50)]
"""What names a file on a host must be a digest; what arrives is checked when it is decoded."""


class SentFile(msgspec.Struct, frozen=True, kw_only=True):
    """A file that travels.

    Attributes:
        path: relative to the root of its bundle.
        sha256: of its content, in hexadecimal digits.
        recording: the digest of the recording that it is a part of, if any.
    """

    path: str
    size: Count
    sha256: Sha256
    executable: bool = False
    recording: str = ""


class SentRecording(msgspec.Struct, frozen=True, kw_only=True):
    """A recording that a plan names.

    Attributes:
        path: where it must be, relative to the root of the bundle, or absolute: hosts must have
            it at this very path then.
        sha256: `r2bspec.bags.integrity.hash_files` of it.
    """

    path: str
    sha256: Sha256


class Side(msgspec.Struct, frozen=True, kw_only=True):
    """A benchmark: its plan and resolved spec, and its folder in the bundle."""

    plan: str
    spec_text: str
    base_dir: str


class Job(msgspec.Struct, frozen=True, kw_only=True):
    """One run, or one comparison in pairs, which never leaves its host.

    Attributes:
        identity: names the run on its host: the same identity is never played twice.
        bundle: identifies `files`.
        head: is run, and judged.
        base: of a comparison, if it is another spec; None if it is the head.
        against: the base as the user wrote it.
        environments: of the base: setup files and installed workspaces of the host.
    """

    identity: Identity
    name: str
    bundle: Sha256
    files: tuple[SentFile, ...]
    recordings: tuple[SentRecording, ...]
    head: Side
    base: Side | None = None
    compares: bool = False
    against: str = ""
    environments: tuple[str, ...] = ()
    pairs: int | None = None
    control: bool = False
    force: bool = False
    smoke: bool = False
    abort_on_fail: bool = False
    anatomy: bool = False

    @property
    def sides(self) -> tuple[Side, ...]:
        """The benchmarks: one, or both of a comparison of two specs."""
        return (self.head,) if self.base is None else (self.head, self.base)


@dataclass(frozen=True)
class Bundle:
    """What travels of one or two benchmarks.

    Attributes:
        sides: the benchmarks, with folders relative to the root.
        sources: where each content is on this machine, by digest.
        recordings: those that hosts do not make themselves.
    """

    digest: str
    files: tuple[SentFile, ...]
    sides: tuple[Side, ...]
    sources: Mapping[str, Path]
    recordings: tuple[SentRecording, ...]


def make_bundle(sides: Sequence[PreparedBenchmark]) -> Bundle:
    """Collect what the plans name.

    Raises:
        BundleTooLargeError: it is more than hosts take.
        DataError: a recording does not exist or cannot be read.
    """
    files = {file for side in sides for file in _named_files(side.plan, side.base_dir)}
    bags = {bag.at: bag for side in sides for bag in _recordings(side)}
    places = [str(_plain_path(side.base_dir)) for side in sides]
    places += [str(file.parent) for file in files]
    places += [str(bag.top) for bag in bags.values() if not bag.is_absolute]
    places += [str(top) for side in sides for top in _tops(side.plan, side.base_dir)]
    root = Path(os.path.commonpath(places))
    _check_size(files)
    sources: dict[str, Path] = {}
    sent = list(_described(root, sorted(files), sources))
    recordings = []
    for bag in bags.values():
        sha256 = hash_files(bag.source)
        path = str(bag.at) if bag.is_absolute else bag.at.relative_to(root).as_posix()
        recordings.append(SentRecording(path=path, sha256=sha256))
        if not bag.is_absolute:
            sent += _described(bag.source, bag.files, sources, path, sha256)
    return Bundle(
        digest=bundle_digest(sent),
        files=tuple(sent),
        sides=tuple(
            Side(
                plan=canonical_json(side.plan).decode(),
                spec_text=side.spec_text,
                base_dir=os.path.relpath(_plain_path(side.base_dir), root),
            )
            for side in sides
        ),
        sources=sources,
        recordings=tuple(recordings),
    )


def bundle_digest(files: Sequence[SentFile]) -> str:
    """The digest that names the files of a bundle."""
    return hashlib.sha256(msgspec.json.encode(files)).hexdigest()


def digest_of(file: Path) -> str:
    """The SHA-256 of a file."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _described(
    root: Path,
    files: Iterable[Path],
    sources: dict[str, Path],
    prefix: str = "",
    recording: str = "",
) -> Iterator[SentFile]:
    """Files as they travel; those of a recording are below the path where it must be."""
    for file in files:
        sha256 = digest_of(file)
        sources[sha256] = file
        yield SentFile(
            path=Path(prefix, file.relative_to(root)).as_posix(),
            size=file.stat().st_size,
            sha256=sha256,
            executable=not recording and os.access(file, os.X_OK),
            recording=recording,
        )


def _check_size(files: Collection[Path]) -> None:
    sizes = {file: file.stat().st_size for file in files}
    if sum(sizes.values()) > limits.MAX_BUNDLE_BYTES or len(sizes) > limits.MAX_BUNDLE_FILES:
        raise BundleTooLargeError(
            f"the files that the spec names have more than {Size(limits.MAX_BUNDLE_BYTES)} or are "
            f"more than {limits.MAX_BUNDLE_FILES:,}; the largest is "
            f"{max(sizes, key=lambda file: sizes[file])}",
            hint="Install large parts on the hosts, and name them there.",
        )


@dataclass(frozen=True)
class _Recording:
    """A recording that a plan names: where its run looks for it, and where it is here.

    Attributes:
        top: the lowest folder that has both it and all that its path goes through.
    """

    at: Path
    source: Path
    is_absolute: bool
    top: Path

    @property
    def files(self) -> list[Path]:
        if not self.source.is_dir():
            return [self.source]
        return sorted(regular_files(self.source))


def _recordings(side: PreparedBenchmark) -> Iterator[_Recording]:
    """The recordings of a plan; hosts make synthetic ones themselves."""
    from r2bspec.datasets.catalogue import locate

    base_dir = _plain_path(side.base_dir)
    for dataset in side.plan.datasets or (side.plan.dataset,):
        location = locate(dataset.source, side.base_dir) if dataset.source else None
        if location is None or location.path is None:
            continue
        named = Path(os.path.expanduser(dataset.source))  # noqa: PTH111
        at = _plain_path(side.base_dir / named)
        top = Path(os.path.commonpath((at.parent, _top_of(base_dir, dataset.source))))
        yield _Recording(at, location.path, named.is_absolute(), top)


def _named_files(plan: Plan, folder: Path) -> Iterator[Path]:
    """Every file that a plan names, and what Python files of it import from their own folders."""
    base_dir = _plain_path(folder)
    for word in _all_words(plan):
        yield from _files_at(base_dir, word)
    for process in plan.processes:
        records = (base_dir / "interfaces" / f"{node.node}.yaml" for node in process.nodes)
        yield from (record for record in records if record.is_file())


def _tops(plan: Plan, folder: Path) -> Iterator[Path]:
    """The highest folders that the paths of a plan go through, where they name files."""
    base_dir = _plain_path(folder)
    for word in _all_words(plan):
        if ".." in word and next(_files_at(base_dir, word), None) is not None:
            yield _top_of(base_dir, word)


def _top_of(base_dir: Path, path: str) -> Path:
    """The highest folder that a relative path goes through: of ``../x/y``, the parent."""
    depth = lowest = 0
    for part in Path(path).parts:
        depth += -1 if part == ".." else 1
        lowest = min(lowest, depth)
    above = (base_dir, *base_dir.parents)
    return above[min(-lowest, len(above) - 1)]


def _plain_path(path: Path) -> Path:
    """The path without ``..``; links stay, because plans name what is behind them so."""
    return Path(os.path.normpath(path.absolute()))


def _all_words(plan: Plan) -> Iterator[str]:
    """Every text of what a run starts, loads and calls; topics and labels name no files.

    Also the path in ``./node.py:Class``, ``file:=x.launch.py`` and ``NAME=x.yaml``.
    """
    processes = [[process.argv, process.env, process.nodes] for process in plan.processes]
    for text in texts(msgspec.to_builtins([processes, plan.setup, plan.after_ready])):
        yield text
        _, assigned, value = text.partition(":=")
        if assigned:
            yield value
            continue
        yield text.rpartition(":")[0]
        yield text.partition("=")[2]


def _files_at(base_dir: Path, word: str) -> Iterator[Path]:
    is_path = 0 < len(word) <= limits.MAX_BUNDLE_PATH_CHARACTERS and not set(word) & {"\0", "\n"}
    if not is_path or word[0] in "/~":
        return
    place = Path(os.path.normpath(base_dir / word))
    if place in (base_dir, *base_dir.parents):
        return
    try:
        # A word such as a name of a topic is no path, even if a folder has that name.
        if place.is_dir() and "/" in word:
            yield from _files_below(place)
        elif place.is_file():
            yield place
            if place.suffix == ".py":
                yield from _imported(place)
    except OSError:
        return


def _files_below(folder: Path) -> Iterator[Path]:
    for parent, folders, files in walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__pycache__")))
        yield from (parent / name for name in sorted(files))


def _imported(file: Path) -> Iterator[Path]:
    """The modules in the folder of a Python file that it imports, directly or indirectly."""
    seen = {file}
    pending = [file]
    while pending:
        imports, _ = imports_of(pending.pop())
        for name in {name.partition(".")[0] for level, name, _ in imports if name and not level}:
            module = (file.parent / name).with_suffix(".py")
            package = file.parent / name
            modules = [module] if module.is_file() else []
            if not modules and (package / "__init__.py").is_file():
                modules = list(_files_below(package))
            for source in modules:
                if source not in seen:
                    seen.add(source)
                    yield source
                    if source.suffix == ".py":
                        pending.append(source)
