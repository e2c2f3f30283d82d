"""Reports of `validate` that are kept until something changes that their check looked up.

A check reads more than the spec: files that it extends or names, bags, the Python modules, ROS
packages and programs that are installed, variables of the environment. All of that is noted while
a spec is checked (`r2bspec.untrusted.looked_up_files`), also what was looked for and is not there.
A report is used again only where all of it is as it was: files that were read by their content,
everything else by its stamp, of which no program can set the change time. r2bspec itself, the
Python installation, the machine and the options are part of the name of the file in the cache.

The reports of one folder of specs are one file. A file that cannot be read, or is not what it
should be, counts as empty; one that cannot be written is not written.
"""

from __future__ import annotations

import contextlib
import os
import stat
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Final

import msgspec

from r2bspec._version import __version__
from r2bspec.cli.file_report import CheckOptions, FileReport
from r2bspec.private_files import private_files
from r2bspec.untrusted.decompression_budget import chosen_max_bytes
from r2bspec.untrusted.looked_up_files import Lookups, Stamp, stamp
from r2bspec.untrusted.safe_file import read_bytes

NO_CACHE_VARIABLE: Final = "R2BSPEC_NO_CACHE"
"""If it is set, every file is checked."""

_FORMAT: Final = 1
"""Increase this with every change of the types below."""

_MAX_FILE_BYTES: Final = 64_000_000
_MAX_FILES: Final = 4_000
"""Folders, options and versions of which reports are kept: those used last."""
_MAX_BYTES: Final = 256_000_000
"""Of all files together."""
_DIGEST_LENGTH: Final = 64
"""Characters before the content of a file: what a damaged disk left is not shown."""
_MAX_REPORTS: Final = 20_000
"""In one file."""
_MAX_DIGEST_BYTES: Final = 1_000_000
"""Larger files are known by their stamp only, as bags are."""

_SETTLED_NS: Final = 100_000_000
"""What changed less than this before it was looked up could change again with the same stamp: the
clock of a file system may stand still for some milliseconds."""

_BOOT: Final = Path("/proc/sys/kernel/random/boot_id")
_GPUS: Final = ("/proc/driver/nvidia/gpus", "/dev/nvhost-gpu", "/dev/kfd", "/dev/shm")  # noqa: S108
"""What a check asks of the machine, apart from what is noted."""


_Index = Annotated[int, msgspec.Meta(ge=0)]


class Dependencies(msgspec.Struct, frozen=True):
    """What a report depends on.

    Attributes:
        files: the state of each file and folder by its path; empty for what is not there.
        variables: a digest of each variable of the environment; empty for one that is not set.
    """

    files: Mapping[str, str]
    variables: Mapping[str, str]


class _Entry(msgspec.Struct, frozen=True, array_like=True):
    """One report: `files` and `variables` are indices into the lists of its file."""

    report: FileReport
    files: list[_Index]
    variables: list[_Index]


_Made = tuple[FileReport, Dependencies]


class _Stored(msgspec.Struct, frozen=True):
    """A file of the cache; states that several reports depend on are in it once."""

    files: list[tuple[str, str]] = []
    variables: list[tuple[str, str]] = []
    entries: dict[str, _Entry] = {}


class ReportCache:
    """The reports of earlier checks with the same options.

    Args:
        options: of the check.
        folder: of the cache; by default r2bspec's in the user's cache folder.

    Raises:
        OSError: the system does not tell on what reports depend.
    """

    def __init__(self, options: CheckOptions, folder: Path | None = None) -> None:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
        self._folder = folder or base / "r2bspec" / "reports"
        self._states = CurrentStates()
        self._scope = _scope(options, self._states)
        self._stored: dict[str, _Stored] = {}
        self._new: dict[str, dict[str, _Made]] = {}

    @classmethod
    def of_check(cls, files: Iterable[str], options: CheckOptions) -> ReportCache | None:
        """The cache of a check; None for standard input and for the rules for strangers."""
        if os.environ.get(NO_CACHE_VARIABLE) or "-" in files:
            return None
        if options.untrusted is not None or options.resolved:
            return None
        try:
            return cls(options)
        except (OSError, RuntimeError):
            # There is no current folder, or no home folder.
            return None

    def get(self, file: str) -> FileReport | None:
        """The report of a file, if nothing has changed that it depends on."""
        stored = self._read(self._group(file))
        entry = stored.entries.get(file)
        if entry is None:
            return None
        try:
            same = all(self._states.is_file(*stored.files[each]) for each in entry.files) and all(
                self._states.is_variable(*stored.variables[each]) for each in entry.variables
            )
        except IndexError:
            return None
        return entry.report if same else None

    def dependencies(self, seen: Lookups, started_ns: int) -> Dependencies | None:
        """As `CurrentStates.dependencies`; in any process."""
        return self._states.dependencies(seen, started_ns)

    def put(self, file: str, report: FileReport, dependencies: Dependencies | None) -> None:
        """Keep a report; None: it cannot be kept."""
        if dependencies is not None:
            self._new.setdefault(self._group(file), {})[file] = report, dependencies

    def write(self) -> None:
        """Write what is new; where that fails, the next check takes longer."""
        if not self._new:
            return
        with contextlib.suppress(OSError), private_files():
            self._folder.mkdir(parents=True, exist_ok=True)
            for group, reports in self._new.items():
                content = msgspec.json.encode(_with_new(self._read(group), reports))
                if len(content) < _MAX_FILE_BYTES:
                    signed = self._states.digest_bytes(content) + content
                    _replace(self._folder / f"{group}.json", signed)
            _remove_oldest(self._folder)

    def _group(self, file: str) -> str:
        return self._states.digest((self._scope, os.path.dirname(file)))  # noqa: PTH120

    def _read(self, group: str) -> _Stored:
        if group not in self._stored:
            self._stored[group] = self._read_file(self._folder / f"{group}.json")
        return self._stored[group]

    def _read_file(self, place: Path) -> _Stored:
        try:
            signed = read_bytes(place, max_bytes=_MAX_FILE_BYTES + 100)
            content = signed[_DIGEST_LENGTH:]
            if self._states.digest_bytes(content) != signed[:_DIGEST_LENGTH]:
                return _Stored()
            found = msgspec.json.decode(content, type=_Stored)
            os.utime(place)  # used last, and removed last
        except (OSError, ValueError, msgspec.DecodeError, RecursionError):
            return _Stored()
        return found


class CurrentStates:
    """Files and variables as they are now, each looked at once.

    What is asked for is true for as long as a check of many files takes: one moment.
    """

    def __init__(self) -> None:
        import hashlib

        self._sha256 = hashlib.sha256
        self._files: dict[tuple[str, bool], str] = {}
        self._kept: dict[tuple[str, Stamp, bool], str | None] = {}

    def digest(self, value: object) -> str:
        """A digest of what `repr` says of a value."""
        return self.digest_bytes(repr(value).encode("utf-8", "backslashreplace")).decode()

    def digest_bytes(self, content: bytes) -> bytes:
        """A digest in hexadecimal digits."""
        return self._sha256(content).hexdigest().encode()

    def is_file(self, path: str, state: str) -> bool:
        """Whether a file is in that state."""
        by_content = state.startswith("sha256:")
        key = path, by_content
        if key not in self._files:
            self._files[key] = self._content(path) if by_content else _stamp_text(stamp(path))
        return self._files[key] == state

    def is_variable(self, name: str, state: str) -> bool:
        """Whether a variable of the environment has a value with that digest."""
        return self._variable(name, os.environ.get(name)) == state

    def dependencies(self, seen: Lookups, started_ns: int) -> Dependencies | None:
        """What a report depends on; None if it cannot be kept.

        Args:
            seen: what its check looked up.
            started_ns: when the check started, of the system's clock.
        """
        if not seen.complete:
            return None
        files: dict[str, str] = {}
        for path, before in seen.files.items():
            state = self._state(path, before, path in seen.read, started_ns)
            if state is None:
                return None
            files[path] = state
        variables = {name: self._variable(name, value) for name, value in seen.variables.items()}
        return Dependencies(files, variables)

    def _state(self, path: str, before: Stamp, was_read: bool, started_ns: int) -> str | None:
        """The state of a file that was looked up; None if it may not be what the check saw."""
        key = path, before, was_read
        if key not in self._kept:
            self._kept[key] = self._settled_state(path, before, was_read, started_ns)
        return self._kept[key]

    def _settled_state(
        self, path: str, before: Stamp, was_read: bool, started_ns: int
    ) -> str | None:
        if before is not None and max(before[0], before[3]) > started_ns - _SETTLED_NS:
            return None
        state = self._content(path) if was_read and before is not None else _stamp_text(before)
        return state if stamp(path) == before else None

    def _variable(self, name: str, value: str | None) -> str:
        # Not the value: it may be a secret.
        return "" if value is None else self.digest((name, value))

    def _content(self, path: str) -> str:
        """A digest of a regular file; its stamp if it is none, or large."""
        try:
            number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
        except (OSError, ValueError):
            return _stamp_text(stamp(path))
        with os.fdopen(number, "rb", buffering=0) as file:
            status = os.fstat(number)
            if not stat.S_ISREG(status.st_mode) or status.st_size > _MAX_DIGEST_BYTES:
                return _stamp_text(stamp(path))
            # A link may lead somewhere else, which decides whether it may be read at all.
            real = os.fsencode(os.readlink(f"/proc/self/fd/{number}"))  # noqa: PTH115
            content = file.read(_MAX_DIGEST_BYTES + 1)
            return f"sha256:{self._sha256(real + bytes(1) + content).hexdigest()}"


def _stamp_text(found: Stamp) -> str:
    return "" if found is None else ",".join(map(str, found))


def _scope(options: CheckOptions, states: CurrentStates) -> str:
    package = Path(__file__).parents[1]
    return states.digest(
        [
            (_FORMAT, __version__, sys.version, sys.flags, os.geteuid(), os.getcwd()),  # noqa: PTH109
            [(each, stamp(each)) for each in sys.path],
            sorted(_stamps(str(package))),
            (os.uname(), sorted(os.sched_getaffinity(0)), _boot(), [*map(_device, _GPUS)]),
            (options.sets, sorted((options.variables or {}).items()), options.case),
            ([str(each) for each in options.allow_paths], options.offline, chosen_max_bytes()),
        ]
    )


def _stamps(folder: str) -> Iterator[tuple[str, int, int, int]]:
    """The modules and data of r2bspec itself, which may be edited where it is installed."""
    with os.scandir(folder) as found:
        for each in found:
            if each.is_dir(follow_symlinks=False):
                if each.name != "__pycache__":
                    yield from _stamps(each.path)
            else:
                status = each.stat()
                yield each.path, status.st_mtime_ns, status.st_size, status.st_ctime_ns


def _boot() -> str:
    with contextlib.suppress(OSError):
        return _BOOT.read_text()
    return str(time.time_ns())


def _device(path: str) -> object:
    try:
        found = os.statvfs(path)
        return sorted(os.listdir(path)) if "gpus" in path else found.f_blocks * found.f_frsize  # noqa: PTH208
    except OSError:
        return os.path.exists(path)  # noqa: PTH110


def _with_new(old: _Stored, new: Mapping[str, _Made]) -> _Stored:
    """The reports of a file with new ones; of too many, the new ones and the last."""
    room = max(_MAX_REPORTS - len(new), 0)
    kept = [(name, entry) for name, entry in old.entries.items() if name not in new]
    files: dict[tuple[str, str], int] = {}
    variables: dict[tuple[str, str], int] = {}
    entries: dict[str, _Entry] = {}

    def number(numbers: dict[tuple[str, str], int], pair: tuple[str, str]) -> int:
        return numbers.setdefault(pair, len(numbers))

    for name, entry in kept[-room:] if room else ():
        with contextlib.suppress(IndexError):
            entries[name] = _Entry(
                entry.report,
                [number(files, old.files[each]) for each in entry.files],
                [number(variables, old.variables[each]) for each in entry.variables],
            )
    for name, (report, found) in new.items():
        entries[name] = _Entry(
            report,
            [number(files, each) for each in found.files.items()],
            [number(variables, each) for each in found.variables.items()],
        )
    return _Stored([*files], [*variables], entries)


def _replace(place: Path, content: bytes) -> None:
    scratch = place.with_name(f".{place.name}.{os.getpid()}")
    try:
        scratch.write_bytes(content)
        scratch.replace(place)
    finally:
        scratch.unlink(missing_ok=True)


def _remove_oldest(folder: Path) -> None:
    """Keep the cache below its limits."""
    found = []
    for each in os.scandir(folder):
        with contextlib.suppress(OSError):
            status = each.stat()
            found.append((status.st_mtime_ns, status.st_size, each.path))
    total = 0
    for position, (_, size, path) in enumerate(sorted(found, reverse=True)):
        total += size
        if position >= _MAX_FILES or total > _MAX_BYTES:
            with contextlib.suppress(OSError):
                os.unlink(path)  # noqa: PTH108
