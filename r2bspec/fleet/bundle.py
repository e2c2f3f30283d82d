"""What of a spec's files a run on another machine needs: only what its plan names.

Every path of a plan is relative to the folder of its spec. A bundle keeps these relations: its root
is the lowest folder that has all of them, and all that they go through, so that
``../config/x.yaml`` and ``../specs/bag`` are found on a host as they are here. The digest of a
bundle covers the paths, the contents and the executable bits.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.bags.integrity import hash_files
from r2bspec.errors import UsageError
from r2bspec.fleet.host_messages import SentFile, SentRecording, Side
from r2bspec.fleet.named_files import named_files, parts, plain_path, top_of, tops
from r2bspec.language.quantities import Size
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.plan import DatasetPlan, Plan

MAX_BUNDLE_BYTES: Final = 512 << 20
"""A folder that a command names may be a whole workspace, which belongs on the host."""

_MAX_FILES: Final = 20_000
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
    named = [(side, sorted(set(named_files(side.plan, side.base_dir)))) for side in sides]
    recordings = [found for side in sides for found in _recordings(side)]
    places = [str(plain_path(side.base_dir)) for side in sides]
    places += [str(each.parent) for _, files in named for each in files]
    places += [str(each.top) for each in recordings if not each.absolute]
    places += [str(each) for side in sides for each in tops(side.plan, side.base_dir)]
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
                base_dir=os.path.relpath(plain_path(side.base_dir), root),
            )
            for side in sides
        ),
        sources=sources,
        recordings=sent,
        recording_sources=recording_sources,
    )


def needs_of(plan: Plan, bundle: str) -> str:
    """Identifies what a plan needs of a host: plans with the same needs run there or do not.

    Rates, durations, objectives and titles were checked where the plan was made.
    """
    found = [
        *(bundle, plan.requires or None, plan.environment, plan.transport, plan.segment_bytes),
        *(plan.datasets or plan.dataset, plan.topics, parts(plan)),
    ]
    return hashlib.sha256(msgspec.json.encode(found, enc_hook=str)).hexdigest()


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
        at = plain_path(side.base_dir / at)
        ways = (at.parent, top_of(plain_path(side.base_dir), each.source))
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


def _files_of(bag: Path) -> tuple[SentFile, ...]:
    if not bag.is_dir():
        return (_sent(bag, bag.name),)
    inside = sorted(each for each in bag.rglob("*") if each.is_file())
    return tuple(_sent(each, each.relative_to(bag).as_posix()) for each in inside)


def _sent(file: Path, path: str) -> SentFile:
    sha256, size = digest_of(file)
    return SentFile(path=path, size=size, sha256=sha256)
