"""Reading the events that processes of a graph have recorded (``r2bspec/native/anatomy.c``).

Each process has a file of its own, of a fixed size: a header, a table of objects, and rows of
events in slabs, each filled by one thread. A process may end at any time, by any signal: its
finished events are in the file.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, BinaryIO, Final, TypeVar

import numpy as np

from r2bspec.record.files import RecordError
from r2bspec.record.run_record import AnatomyKind, AnatomyObject, AnatomyObjectKind, AnatomyProcess
from r2bspec.record.sample_arrays import ANATOMY_DTYPE, LONGEST_NS, Rows
from r2bspec.safe_io.limits import MAX_ANATOMY_EVENTS, MAX_ANATOMY_FILES
from r2bspec.safe_io.safe_file import open_regular

SUFFIX: Final = ".rows"

_MAGIC: Final = b"R2BROWS1"
_HEADER: Final = np.dtype(
    {
        "names": ["magic", "pid", "slabs", "process", "claimed", "objects", "lost"],
        "formats": ["S8", "<u4", "<u4", "S256", "<u4", "<u4", "<u8"],
        "offsets": [0, 8, 12, 16, 320, 324, 328],
        "itemsize": 4096,
    }
)
_OBJECT: Final = np.dtype([("kind", "<u4"), ("name", "S256"), ("node", "S256")])
_OBJECTS: Final = 2048
_SLAB_ROWS: Final = 256
_SLAB_BYTES: Final = _SLAB_ROWS * ANATOMY_DTYPE.itemsize
_ROWS_AT: Final = _HEADER.itemsize + _OBJECTS * _OBJECT.itemsize

_Known = TypeVar("_Known")

_OBJECT_KINDS: Final[tuple[AnatomyObjectKind, ...]] = (
    *("publisher", "subscription", "timer"),
    *("client", "service", "buffer"),
)
"""From 1 on."""


def file_bytes(events: int) -> int:
    """Return the size of a file with room for `events` events, of up to 16 threads.

    A thread leaves its last slab unfinished.
    """
    return _ROWS_AT + (events + 16 * _SLAB_ROWS) * ANATOMY_DTYPE.itemsize


class AnatomyReader:
    """Reads repeatedly what the processes of a folder record while they run.

    Processes and objects keep their numbers from one reading to the next, whatever is added.

    Args:
        folder: the folder of their files; others are passed over.

    Attributes:
        unread: files that were not read, because there are too many.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.unread = 0
        self._files: dict[Path, _EventFile] = {}
        self._objects: list[AnatomyObject] = []
        self._processes: list[AnatomyProcess] = []

    def read(
        self, passed_ns: int = 0
    ) -> tuple[Rows, tuple[AnatomyObject, ...], tuple[AnatomyProcess, ...]]:
        """Return the events that have been recorded since those already passed.

        A file that its process is still creating is left out, and so are unfinished events. Events
        beyond the limit for all, and impossible events, are counted as lost.

        Args:
            passed_ns: full slabs with events before this time alone are not read again.

        Returns:
            The events in the order in which they began, all that events belong to, and the
            processes.

        Raises:
            RecordError: a file cannot be read, or is damaged.
        """
        arrays = [np.empty(0, ANATOMY_DTYPE)]
        # Rows that are no events take time and memory, too.
        room = unread = MAX_ANATOMY_EVENTS
        paths = sorted(_find_files(self._folder), key=lambda path: (path not in self._files, path))
        self.unread = max(0, len(paths) - MAX_ANATOMY_FILES)
        for path in paths[:MAX_ANATOMY_FILES]:
            read = self._files.setdefault(path, _EventFile(path))
            try:
                with open_regular(path, folders=[self._folder]) as file:
                    table = file.read(_ROWS_AT)
                    if not table.strip(b"\0"):
                        # Its process is still making it.
                        continue
                    rows = read.events(file, table, min(room, unread), passed_ns)
            except OSError as error:
                raise RecordError(f"{path} cannot be read: {error.strerror}", hint=_HINT) from error
            read.number(table, rows, self._objects, self._processes)
            arrays.append(rows)
            room -= len(rows)
            unread -= read.rows
        joined = np.concatenate(arrays)
        order = np.argsort(joined["began_ns"], kind="stable")
        return joined[order], tuple(self._objects), tuple(self._processes)


def _find_files(folder: Path) -> list[Path]:
    try:
        return [path for path in folder.iterdir() if path.suffix == SUFFIX]
    except OSError as error:
        raise RecordError(f"{folder} cannot be read: {error.strerror}", hint=_HINT) from error


class _EventFile:
    """The file of one process, and which of its slabs were passed.

    Attributes:
        rows: the rows that were read last, whether they are events or not.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.rows = 0
        self._passed = np.zeros(0, np.bool_)
        self._lost = 0
        """Of what was read last; slabs in which something is lost are never passed."""
        self._process: int | None = None
        self._numbers: dict[int, int] = {}
        """Of its objects, by their places in its table."""

    def events(self, file: BinaryIO, table: bytes, room: int, passed_ns: int) -> Rows:
        """Return the finished events, at most `room`, behind the header and the objects."""
        if len(table) < _ROWS_AT or table[: len(_MAGIC)] != _MAGIC:
            raise RecordError(f"{self._path} is damaged: it has no header of events", hint=_HINT)
        header = np.frombuffer(table, _HEADER, count=1)[0]
        if int(header["lost"]) > LONGEST_NS:
            raise RecordError(
                f"{self._path} is damaged: it reports more lost events than possible", hint=_HINT
            )
        slabs = min(int(header["slabs"]), int(header["claimed"]))
        return self._read_slabs(file, slabs, room, passed_ns)

    def number(
        self,
        content: bytes,
        rows: Rows,
        objects: list[AnatomyObject],
        processes: list[AnatomyProcess],
    ) -> None:
        """Number process and objects of rows as in these lists, to which new ones are added."""
        header = np.frombuffer(content, _HEADER, count=1)[0]
        lost = int(header["lost"]) + self._lost
        whose = AnatomyProcess(name=_text(header["process"]), pid=int(header["pid"]), lost=lost)
        self._process = _put(processes, whose, self._process)
        table = np.frombuffer(content, _OBJECT, count=_OBJECTS, offset=_HEADER.itemsize)
        named = min(int(header["objects"]), _OBJECTS)
        # 0 is no object.
        numbers = np.zeros(named + 1, np.uint32)
        for place, (kind, name, node) in enumerate(table[:named].tolist()):
            # 0 until it is finished.
            if 0 < kind <= len(_OBJECT_KINDS):
                each = AnatomyObject(
                    process=self._process,
                    kind=_OBJECT_KINDS[kind - 1],
                    name=_text(name),
                    node=_text(node),
                )
                self._numbers[place] = _put(objects, each, self._numbers.get(place))
                numbers[place + 1] = self._numbers[place] + 1
        rows["object"] = numbers[np.where(rows["object"] <= named, rows["object"], 0)]
        rows["process"] = self._process

    def _read_slabs(self, file: BinaryIO, slabs: int, room: int, passed_ns: int) -> Rows:
        """Return the rows of all slabs that were not passed.

        Those that follow each other in one go.
        """
        self._lost = self.rows = 0
        # What a header says is not believed: the file has an end.
        there = -(-max(0, os.fstat(file.fileno()).st_size - _ROWS_AT) // _SLAB_BYTES)
        self._lost += max(0, slabs - there) * _SLAB_ROWS
        slabs = min(slabs, there)
        passed = np.zeros(slabs, np.bool_)
        passed[: self._passed.size] = self._passed[:slabs]
        left = np.flatnonzero(~passed)
        arrays = [np.empty(0, ANATOMY_DTYPE)]
        for run in np.split(left, 1 + np.flatnonzero(np.diff(left) > 1)):
            if not run.size:
                continue
            file.seek(_ROWS_AT + int(run[0]) * _SLAB_BYTES)
            wanted = min(run.size, max(0, room) // _SLAB_ROWS + 1)
            rows = _read_rows(file, wanted * _SLAB_ROWS)
            self.rows += len(rows)
            finished = rows["kind"] != 0
            possible = finished & _are_possible(rows)
            kept = np.flatnonzero(possible)[: max(0, room)]
            missing = int(run.size) * _SLAB_ROWS - len(rows)
            lost = missing + int(finished.sum()) - len(kept)
            self._lost += lost
            arrays.append(rows[kept])
            room -= len(kept)
            if not lost:
                began = np.where(finished, rows["began_ns"], LONGEST_NS)
                passed[run] = began.reshape(-1, _SLAB_ROWS).max(axis=1) < passed_ns
        self._passed = passed
        return np.concatenate(arrays)


def _read_rows(file: BinaryIO, count: int) -> Rows:
    content = file.read(count * ANATOMY_DTYPE.itemsize)
    whole = len(content) - len(content) % ANATOMY_DTYPE.itemsize
    rows: Rows = np.frombuffer(content[:whole], ANATOMY_DTYPE).copy()
    return rows


def _are_possible(rows: Rows) -> Any:
    times = [rows[name] for name in rows.dtype.names or () if name.endswith("_ns")]
    in_time = np.all([(each >= -LONGEST_NS) & (each <= LONGEST_NS) for each in times], axis=0)
    known = rows["kind"] <= max(AnatomyKind)
    return in_time & known & (rows["began_ns"] <= rows["ended_ns"])


def _put(known: list[_Known], value: _Known, place: int | None) -> int:
    """Put a value at its place, or at the end if it has none; returns the place."""
    if place is None:
        known.append(value)
        return len(known) - 1
    known[place] = value
    return place


def _text(stored: bytes) -> str:
    """Return a name, which C ends with a zero."""
    return bytes(stored).split(b"\0")[0].decode(errors="replace")


_HINT = "Something else has written to the folder, or the disk is full; run the benchmark again."
