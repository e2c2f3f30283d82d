"""The search for files below a folder, which follows no links, and for a path that was meant."""

from __future__ import annotations

import fnmatch
import glob
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from r2bspec.diagnostics.quote import did_you_mean, quote
from r2bspec.safe_io.safe_file import is_there, names_if_any

_ANY_FOLDERS: Final = "**"
_MAX_FOLDERS_UP: Final = 3
_MAX_FOLDERS_BELOW: Final = 100


def matching_files(pattern: str) -> list[str]:
    """Return the files that match a pattern of the shell, sorted.

    ``*``, ``?`` and ``[...]`` stand for parts of a name, and ``**`` for any folders. They find no
    hidden names, and ``**`` follows no links, so that no link leads in a circle.
    """
    above, any_folders, below = pattern.partition(_ANY_FOLDERS)
    if not any_folders:
        return sorted(filter(os.path.isfile, glob.glob(pattern)))  # noqa: PTH207 - as written
    below = below.lstrip("/") or "*"
    folders = (
        folder
        for root in (glob.glob(above) if above else [""])  # noqa: PTH207
        for folder, _ in _visible_folders(root)
    )
    matches = (matching_files(os.path.join(glob.escape(folder), below)) for folder in folders)  # noqa: PTH118
    return sorted({file for files in matches for file in files})


def files_below(folder: str, name: str) -> list[str]:
    """Return all but folders below a folder whose name matches a pattern, sorted.

    Pipes and links that lead nowhere are among them: a spec that is one gets a finding.

    Args:
        folder: where the search begins; empty for the current folder.
        name: a pattern, as those of `matching_files`.
    """
    return sorted(
        os.path.join(parent, file)  # noqa: PTH118 - as the user wrote it
        for parent, files in _visible_folders(folder)
        for file in fnmatch.filter(files, name)
    )


def _visible_folders(folder: str) -> Iterator[tuple[str, list[str]]]:
    """Yield a folder and those below it that are not hidden, each with the names of its files."""
    for parent, folders, files in os.walk(folder or "."):
        folders[:] = [name for name in folders if not name.startswith(".")]
        visible = [name for name in files if not name.startswith(".")]
        yield parent if folder else parent.removeprefix(".").removeprefix("/"), visible


def near_path(path: str | Path, base: Path = Path()) -> str:
    """Return a question with the path that may be meant by one that leads to nothing, if any.

    It is relative to another folder, above or below, or to the current one; or a name is misspelt.

    Args:
        path: relative to `base`.
        base: the folder of a spec, or the current folder.
    """
    if Path(path).is_absolute():
        meant = _similar(Path(path))
        return f"did you mean {quote(str(meant))}?" if meant is not None else ""
    above = (base.joinpath(*[".."] * up) for up in range(1, _MAX_FOLDERS_UP + 1))
    below = (base / name for name in names_if_any(base)[:_MAX_FOLDERS_BELOW])
    places = (folder / path for folder in (Path(), *above, *below))
    meant = next(filter(is_there, places), None) or _similar(base / path)
    if meant is None:
        return ""
    near = os.path.relpath(meant, base)
    dot = "./" if str(path).startswith("./") and not near.startswith(".") else ""
    return f"did you mean {quote(dot + near)}?"


def path_hint(path: str | Path) -> str:
    """Return the way out for a path of the command line that leads to nothing."""
    return near_path(path) or "a path of the command line is relative to the current folder"


def _similar(path: Path) -> Path | None:
    """Return a path that exists, and whose names are similar; None if there is none."""
    place = Path(path.anchor)
    for name in path.parts[len(place.parts) :]:
        if not is_there(place / name):
            name = did_you_mean(name, names_if_any(place))
            if not name:
                return None
        place /= name
    return place


def regular_files(folder: Path) -> Iterator[Path]:
    """Return the regular files below a folder, and what links to such."""
    paths = (Path(parent, name) for parent, _, files in os.walk(folder) for name in files)
    return (path for path in paths if os.path.isfile(path))  # noqa: PTH113 - may be too long
