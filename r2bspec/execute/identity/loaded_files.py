"""The files that the processes of the graph have loaded.

The kernel lists the files that a process has mapped, and those of all processes that it has
started, as a launch file does. Python sources are read and not mapped, so processes of Python
report them themselves: hosts when they are asked (`r2bspec.harness.node_host`), all other programs
when they exit (``r2bspec/harness/module_names``).
"""

from __future__ import annotations

import contextlib
import os
import re
import sysconfig
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from r2bspec.execute.errors import RunError
from r2bspec.execute.processes.resources import family
from r2bspec.execute.processes.supervisor import NO_ANSWER, ManagedProcess, ProcessSupervisor
from r2bspec.ipc import protocol
from r2bspec.record.run_record import ProcessRecord
from r2bspec.safe_io.limits import MAX_LOADED_NAMES_BYTES
from r2bspec.safe_io.safe_file import RefusedFileError, read_bytes

_TOOL: Final = f"{Path(__file__).parents[2]}/"
_DELETED: Final = " (deleted)"
_NO_FILES: Final = ("/dev/", "/memfd:", "/SYSV", "/proc/", "/sys/", "/anon_hugepage")
_TOOL_NODES: Final = f"{_TOOL}nodes/"
_INSTALLED: Final = ("/site-packages/", "/dist-packages/")
_MODULES_TIMEOUT_S: Final = 5.0
_IS_PYTHON: Final = re.compile(r"/(lib)?python[0-9.]*(\.so[0-9.]*)?$")


@dataclass
class LoadedFiles:
    """What the processes of the graph have loaded so far, in all starts of the run.

    Attributes:
        supervisor: all processes.
        note: receives what could not be asked.
        modules_folder: where programs of Python nodes name their modules when they exit.
    """

    supervisor: ProcessSupervisor
    note: Callable[[str], None]
    modules_folder: Path
    _files: dict[str, frozenset[str]] = field(default_factory=dict)
    _others: dict[int, frozenset[str]] = field(default_factory=dict)

    def look(self, hosts: Iterable[ManagedProcess], others: Iterable[ManagedProcess]) -> None:
        """Record the files that running processes have loaded so far.

        Args:
            hosts: processes of Python nodes, which say what they have imported.
            others: further processes of the graph.

        Raises:
            RunError: a process has exited.
        """
        for process in others:
            self._others[process.pid] = mapped_files(process.pid)
            self._add(process.name, self._others[process.pid])
        for host in hosts:
            self._add(host.name, mapped_files(host.pid))
            self._add(host.name, frozenset(loaded_by_graph(self._modules(host))))

    def by_process(
        self, processes: Iterable[ProcessRecord], *, complete: bool
    ) -> dict[str, frozenset[str]]:
        """Return all files by the name of the process, with those that programs reported at exit.

        Args:
            processes: all of the run; they have ended.
            complete: whether they ended as they should, so that what named nothing is noted.
        """
        modules = modules_of_programs(self.modules_folder)
        for process in processes:
            if process.pid in modules:
                self._add(process.name, modules[process.pid])
            elif complete and any(map(_IS_PYTHON.search, self._others.get(process.pid, ()))):
                self.note(f"{process.name} did not say which modules of Python it had imported")
        return self._files

    def _add(self, name: str, files: frozenset[str]) -> None:
        self._files[name] = self._files.get(name, frozenset()) | files

    def _modules(self, host: ManagedProcess) -> tuple[str, ...]:
        """Return what a host has imported; nothing if a node keeps it from answering."""
        try:
            return self.supervisor.request(
                host, protocol.ListModules(), protocol.Modules, _MODULES_TIMEOUT_S
            ).files
        except RunError as error:
            if error.code != NO_ANSWER:
                raise
            self.note(f"{host.name} does not say which modules it has imported")
            return ()


def mapped_files(pid: int) -> frozenset[str]:
    """Return the files that a process and its descendants have mapped.

    A process that has ended has none.
    """
    files: set[str] = set()
    for member in family(pid):
        files.update(_maps(member))
    return frozenset(loaded_by_graph(files))


def modules_of_programs(folder: Path) -> dict[int, frozenset[str]]:
    """Return the modules that Python programs have imported, by the session in which they ran.

    Args:
        folder: has a file of each program: its session and its id, and names separated by zeros.
    """
    modules: dict[int, frozenset[str]] = {}
    for file in folder.glob("*-*"):
        session = int(file.name.partition("-")[0])
        with contextlib.suppress(OSError, RefusedFileError):
            names = os.fsdecode(read_bytes(file, max_bytes=MAX_LOADED_NAMES_BYTES)).split("\0")
            modules[session] = modules.get(session, frozenset()) | {*loaded_by_graph(names)}
    return modules


def loaded_by_graph(files: Iterable[str]) -> Iterator[str]:
    """Return those of some files that are neither of the standard library nor of r2bspec itself."""
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
