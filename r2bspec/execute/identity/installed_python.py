"""The packages, and their versions, to which the Python modules of the graph belong.

Folders are those that a process of the graph searches: those in ``PYTHONPATH`` as it is now, which
differs between the sides of a comparison, and those of this interpreter.
"""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Final

from r2bspec.plan.installed_packages import package_version

_SITES: Final = ("site-packages", "dist-packages")
_FIRST_NAME: Final = re.compile(r"^[^,/.\n]+", re.MULTILINE)
"""The module, package or folder of a line of RECORD or ``top_level.txt``."""

_SYSTEM: Final = tuple({"/usr/", "/opt/ros/", f"{sys.prefix}/", f"{sys.base_prefix}/"})


def _folders() -> list[str]:
    entries = (os.environ.get("PYTHONPATH") or "").split(os.pathsep)
    return [*(str(Path(entry).absolute()) for entry in entries if entry), *sys.path]


def is_installed(file: Path) -> bool:
    """Return True if a file is of the system or of an installed distribution."""
    return str(file).startswith(_SYSTEM) or bool(installed_version(file))


def installed_version(file: Path) -> dict[str, str]:
    """Return the version of the distribution that a file belongs to, with its name.

    Empty if there is none.

    What was installed from a folder, as colcon does it, has a version that says little of its code.
    """
    parts = file.parts
    place = next((at for at, part in enumerate(parts) if part in _SITES), len(parts))
    if place + 1 >= len(parts):
        return {}
    folder = str(Path(*parts[: place + 1]))
    owner = _owners(folder).get(parts[place + 1].partition(".")[0])
    return dict([_name_and_version(owner)]) if owner is not None else {}


@cache
def _name_and_version(owner: importlib.metadata.Distribution) -> tuple[str, str]:
    # Each look at the name or version of a distribution parses its metadata again.
    metadata = owner.metadata
    return metadata["Name"].replace("_", "-"), metadata["Version"]


@cache
def _owners(folder: str) -> Mapping[str, importlib.metadata.Distribution]:
    """Return the distribution of each module, package or folder."""
    owners: dict[str, importlib.metadata.Distribution] = {}
    for distribution in importlib.metadata.distributions(path=[folder]):
        record = distribution.read_text("RECORD")
        from_folder = '"file://' in (distribution.read_text("direct_url.json") or "")
        if from_folder or (record is None and not folder.startswith(_SYSTEM)):
            continue
        listed = record or distribution.read_text("top_level.txt") or ""
        owners |= dict.fromkeys(_FIRST_NAME.findall(listed), distribution)
    return owners


def version_changes(packages: Mapping[str, str]) -> Iterator[str]:
    """Yield the packages that have another version now, as ``numpy 2.1 → 2.2``."""
    for name, before in packages.items():
        now = platform.python_version() if name == "python" else _version(name)
        if now and now != before:
            yield f"{name} {before} → {now}"


def _version(name: str) -> str:
    for distribution in importlib.metadata.distributions(name=name, path=_folders()):
        return distribution.version
    return package_version(name)
