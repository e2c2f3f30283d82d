"""The spec files of a list of paths, folders and patterns."""

from __future__ import annotations

import contextlib
import glob
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from r2bspec.safe_io.safe_file import is_folder, is_regular

SUFFIX = ".r2b.yaml"


def spec_files(paths: Iterable[str]) -> list[str]:
    """The files of `paths`, each once: in the given order, folders and patterns sorted by name.

    Raises:
        click.UsageError: a path that does not exist, or without a spec.
    """
    return list(dict.fromkeys(file for path in paths for file in _expand_path(path)))


def present_spec_files(paths: Iterable[str]) -> list[str]:
    """The same without the paths that do not exist, or have no spec."""
    files: list[str] = []
    for path in paths:
        with contextlib.suppress(click.UsageError):
            files += _expand_path(path)
    return list(dict.fromkeys(files))


def _expand_path(path: str) -> list[str]:
    if path == "-":
        return [path]
    place = Path(path)
    if is_folder(place):
        return _require_files(
            sorted(_find_specs(path)), f"the folder {path!r} has no *{SUFFIX} file"
        )
    if os.path.lexists(place):
        return [path]
    if glob.has_magic(path):
        # Path.glob refuses absolute patterns.
        matches = glob.glob(path, recursive=True)  # noqa: PTH207
        files = sorted(each for each in matches if is_regular(Path(each)))
        return _require_files(files, f"no file matches {path!r}")
    raise click.UsageError(f"{path!r} does not exist")


def _require_files(files: list[str], message: str) -> list[str]:
    if not files:
        raise click.UsageError(message)
    return files


def _find_specs(folder: str) -> Iterator[str]:
    """All specs below a folder, hidden folders left out."""
    for parent, folders, files in os.walk(folder):
        folders[:] = [name for name in folders if not name.startswith(".")]
        yield from (str(Path(parent, name)) for name in files if name.endswith(SUFFIX))
