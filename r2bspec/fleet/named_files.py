"""Which files a plan names, and where their paths go through."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from r2bspec.execute.processes.environment import texts
from r2bspec.plan.plan import Plan

_MAX_SOURCE_BYTES: Final = 1_000_000


def named_files(plan: Plan, folder: Path) -> Iterator[Path]:
    """Every file that a plan names, and what Python files of it import from their own folders.

    Args:
        plan: of a benchmark.
        folder: of its spec.
    """
    base_dir = plain_path(folder)
    for word in _all_words(plan):
        yield from _files_at(base_dir, word)
    for process in plan.processes:
        for node in process.nodes:
            record = base_dir / "interfaces" / f"{node.node}.yaml"
            if record.is_file():
                yield record


def tops(plan: Plan, folder: Path) -> Iterator[Path]:
    """The highest folders that the paths of a plan go through, where they name files."""
    base_dir = plain_path(folder)
    for word in _all_words(plan):
        if ".." in word and next(_files_at(base_dir, word), None) is not None:
            yield top_of(base_dir, word)


def top_of(base_dir: Path, path: str) -> Path:
    """The highest folder that a relative path goes through: of ``../x/y``, the parent."""
    depth = lowest = 0
    for part in Path(path).parts:
        depth += -1 if part == ".." else 1
        lowest = min(lowest, depth)
    above = (base_dir, *base_dir.parents)
    return above[min(-lowest, len(above) - 1)]


def plain_path(path: Path) -> Path:
    """The path without ``..``; links stay, because plans name what is behind them so."""
    return Path(os.path.normpath(path.absolute()))


def parts(plan: Plan) -> list[Any]:
    """What a run starts, loads and calls; topics and labels name no files."""
    return [
        [[each.argv, each.env, each.nodes] for each in plan.processes],
        plan.setup,
        plan.after_ready,
        plan.harness,
    ]


def _all_words(plan: Plan) -> Iterator[str]:
    for text in texts(msgspec.to_builtins(parts(plan))):
        yield from _words(text)


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
