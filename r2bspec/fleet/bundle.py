"""The files that a run on another machine needs: those that its plan names, as one archive.

A path in the archive is the absolute path of the file without its first slash, so that on a host
``../config/x.yaml`` is where it is here, relative to the folder of the spec.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.execute.processes.environment import texts
from r2bspec.fleet.archive import pack
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.plan import Plan
from r2bspec.plan.prepared_benchmark import SPEC_BESIDE_PLAN, PreparedBenchmark
from r2bspec.safe_io.file_search import regular_files

_PLAN_FILE: Final = ".fleet-plan-{}.json"
_MAX_PATH_CHARACTERS: Final = 4_000


def make_bundle(sides: Sequence[PreparedBenchmark]) -> tuple[bytes, list[str]]:
    """Return an archive of what the plans need, and the path of each plan in it.

    Raises:
        ArchiveError: it is more than a host takes.
        DataError: a recording does not exist.
    """
    contents: dict[str, Path | bytes] = {}
    for side in sides:
        contents |= {_path_in_archive(file): file for file in _named_files(side)}
        contents |= _recorded_files(side)
    plans = []
    for number, side in enumerate(sides):
        plan = side.base_dir / _PLAN_FILE.format(number)
        plans.append(_path_in_archive(plan))
        contents[plans[-1]] = canonical_json(side.plan)
        spec = _path_in_archive(plan.with_suffix(SPEC_BESIDE_PLAN))
        contents[spec] = side.spec_text.encode()
    return pack(contents), plans


def _path_in_archive(path: Path) -> str:
    return str(_plain_path(path)).lstrip("/")


def _plain_path(path: Path) -> Path:
    """Return the path without ``..``; links stay, because plans name what is behind them so."""
    return Path(os.path.normpath(path.absolute()))


def _recorded_files(side: PreparedBenchmark) -> dict[str, Path]:
    """Return the files of recordings that are named by relative paths, or by names.

    Hosts render synthetic datasets themselves, and have what is named by an absolute path.
    """
    from r2bspec.datasets.catalogue import locate

    files = {}
    for dataset in side.plan.datasets or (side.plan.dataset,):
        source = dataset.source
        location = locate(source, side.base_dir) if source else None
        if location is None or location.path is None or source.startswith(("/", "~")):
            continue
        place, here = side.base_dir / source, location.path
        for file in regular_files(here) if here.is_dir() else (here,):
            files[_path_in_archive(place / file.relative_to(here))] = file
    return files


def _named_files(side: PreparedBenchmark) -> Iterator[Path]:
    """Yield every file that a plan names, with the Python files beside one that is named."""
    for word in _words(side.plan):
        yield from _files_at(_plain_path(side.base_dir), word)
    for process in side.plan.processes:
        records = (side.base_dir / "interfaces" / f"{node.node}.yaml" for node in process.nodes)
        yield from (record for record in records if record.is_file())


def _words(plan: Plan) -> Iterator[str]:
    """Yield every text of what a run starts, loads and calls; topics and labels name no files.

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
    is_path = 0 < len(word) <= _MAX_PATH_CHARACTERS and not set(word) & {"\0", "\n"}
    if not is_path or word[0] in "/~":
        return
    place = _plain_path(base_dir / word)
    if place in (base_dir, *base_dir.parents):
        return
    try:
        # A word such as the name of a topic is no path, even if a folder has that name.
        if place.is_dir() and "/" in word:
            yield from _files_below(place)
        elif place.is_file():
            yield place
            if place.suffix == ".py":
                yield from place.parent.glob("*.py")
                for package in place.parent.glob("*/__init__.py"):
                    yield from _files_below(package.parent)
    except OSError:
        return


def _files_below(folder: Path) -> Iterator[Path]:
    for parent, folders, files in os.walk(folder):
        folders[:] = sorted(name for name in folders if not name.startswith((".", "__pycache__")))
        yield from (Path(parent, name) for name in sorted(files))
