"""The files that a process has loaded, as the kernel knows them.

These are the files that it has mapped, and those of all processes that it has started: a launch
file is a process of its own. Sources of Python are read and not mapped; processes of Python nodes
name theirs themselves, hosts when they are asked (`r2bspec.harness.node_host`), and programs when
they exit (`r2bspec.harness.node_main`).
"""

from __future__ import annotations

import os
import sysconfig
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final

import msgspec

from r2bspec.execute.host.kernel_counters import family
from r2bspec.safe_io.safe_json import read_json

_TOOL: Final = f"{Path(__file__).parents[2]}/"
_DELETED: Final = " (deleted)"
_NO_FILES: Final = ("/dev/", "/memfd:", "/SYSV", "/proc/", "/sys/", "/anon_hugepage")
_TOOL_NODES: Final = f"{_TOOL}nodes/"
_INSTALLED: Final = ("/site-packages/", "/dist-packages/")


def mapped_files(pid: int) -> frozenset[str]:
    """The files that a process and its descendants have mapped; none of one that has ended."""
    files: set[str] = set()
    for member in family(pid):
        files.update(_maps(member))
    return frozenset(loaded_by_graph(files))


def modules_of_programs(folder: Path) -> dict[int, frozenset[str]]:
    """The modules that programs of Python nodes have imported, by process, from their folder."""
    modules = {}
    for file in folder.glob("*.json"):
        try:
            paths = read_json(file, list[str])
        except (OSError, ValueError, msgspec.DecodeError):
            # One that was killed while it wrote.
            continue
        modules[int(file.stem)] = frozenset(loaded_by_graph(paths))
    return modules


def loaded_by_graph(files: Iterable[str]) -> Iterator[str]:
    """Of some files those that are neither of the standard library nor of r2bspec itself."""
    paths = sysconfig.get_paths()
    library = tuple({f"{os.path.realpath(paths[name])}/" for name in ("stdlib", "platstdlib")})
    for file in files:
        is_of_tool = file.startswith(_TOOL) and not file.startswith(_TOOL_NODES)
        is_standard = file.startswith(library) and not any(name in file for name in _INSTALLED)
        if not is_of_tool and not is_standard:
            yield file


def _maps(pid: int) -> Iterator[str]:
    try:
        text = Path(f"/proc/{pid}/maps").read_text(errors="surrogateescape")
        yield str(Path(f"/proc/{pid}/exe").readlink())
    except OSError:
        return
    for line in text.splitlines():
        # Address, permissions, offset, device, inode, path: without a file there is no path.
        fields = line.split(maxsplit=5)
        path = fields[5] if len(fields) > 5 else ""
        if path.startswith("/") and not path.startswith(_NO_FILES) and not path.endswith(_DELETED):
            yield path
