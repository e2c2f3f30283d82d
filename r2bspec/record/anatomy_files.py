"""Reading what the processes of a graph have recorded of themselves (``r2bspec/native/anatomy.c``).

Each process has a file of its own, of a fixed size: a header, a table of objects, and rows of
events in slabs, each filled by one thread. A process may end at any time, by any signal: what it
had finished until then is in the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, BinaryIO, Final

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
_ROWS_AT: Final = _HEADER.itemsize + _OBJECTS * _OBJECT.itemsize

_OBJECT_KINDS: Final[tuple[AnatomyObjectKind, ...]] = (
    *("publisher", "subscription", "timer"),
    *("client", "service", "buffer"),
)
"""From 1 on."""


def file_bytes(events: int) -> int:
    """The size of a file with room for so many events, of up to 16 threads.

    A thread leaves its last slab unfinished.
    """
    return _ROWS_AT + (events + 16 * _SLAB_ROWS) * ANATOMY_DTYPE.itemsize


def read_anatomy(
    folder: Path,
) -> tuple[Rows, tuple[AnatomyObject, ...], tuple[AnatomyProcess, ...]]:
    """What all processes have recorded in a folder; other files are passed over.

    A file that its process was still making is left out, as are events that it had not finished.
    Events beyond the limit for all are counted as lost, and so are those that cannot be.

    Returns:
        The events in the order in which they began, what they belong to, and the processes.

    Raises:
        RecordError: a file cannot be read, or is damaged.
    """
    objects: list[AnatomyObject] = []
    processes: list[AnatomyProcess] = []
    arrays = [np.empty(0, ANATOMY_DTYPE)]
    room = MAX_ANATOMY_EVENTS
    for path in _find_files(folder):
        try:
            with open_regular(path, folders=[folder]) as file:
                found = _read_file(file, path, len(processes), room)
        except OSError as error:
            raise RecordError(f"{path} cannot be read: {error.strerror}", hint=_HINT) from error
        if found is not None:
            rows, own, process = found
            # 0 is no object.
            rows["object"] += np.where(rows["object"] == 0, 0, len(objects)).astype(np.uint32)
            arrays.append(rows)
            objects += own
            processes.append(process)
            room -= len(rows)
    joined = np.concatenate(arrays)
    return joined[np.argsort(joined["began_ns"], kind="stable")], tuple(objects), tuple(processes)


def _find_files(folder: Path) -> list[Path]:
    try:
        found = sorted(path for path in folder.iterdir() if path.suffix == SUFFIX)
    except OSError as error:
        raise RecordError(f"{folder} cannot be read: {error.strerror}", hint=_HINT) from error
    if len(found) > MAX_ANATOMY_FILES:
        raise RecordError(
            f"{folder} has events of {len(found):,} processes; "
            f"no more than {MAX_ANATOMY_FILES:,} are read",
            hint="Record the events of fewer nodes.",
        )
    return found


def _read_file(
    file: BinaryIO, path: Path, process: int, room: int
) -> tuple[Rows, list[AnatomyObject], AnatomyProcess] | None:
    """The finished events of one process, at most `room`; None if it was still making its file."""
    content = file.read(_ROWS_AT)
    if not content.strip(b"\0"):
        return None
    if len(content) < _ROWS_AT or content[: len(_MAGIC)] != _MAGIC:
        raise RecordError(f"{path} is damaged: it has no header of events", hint=_HINT)
    header = np.frombuffer(content, _HEADER, count=1)[0]
    if int(header["lost"]) > LONGEST_NS:
        raise RecordError(f"{path} is damaged: it has lost more events than can be", hint=_HINT)
    slabs = min(int(header["slabs"]), int(header["claimed"]))
    readable = min(slabs * _SLAB_ROWS, room + _SLAB_ROWS)
    rows = _read_rows(file, readable)
    finished = rows["kind"] != 0
    possible = finished & _are_possible(rows)
    kept = np.flatnonzero(possible)[:room]
    lost = int(header["lost"]) + slabs * _SLAB_ROWS - len(rows) + int(finished.sum()) - len(kept)
    rows = rows[kept]
    table = np.frombuffer(content, _OBJECT, count=_OBJECTS, offset=_HEADER.itemsize)
    named = min(int(header["objects"]), _OBJECTS)
    objects, numbers = _read_objects(table[:named], process)
    rows["object"] = numbers[np.where(rows["object"] <= named, rows["object"], 0)]
    rows["process"] = process
    whose = AnatomyProcess(name=_text(header["process"]), pid=int(header["pid"]), lost=lost)
    return rows, objects, whose


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


def _read_objects(table: Any, process: int) -> tuple[list[AnatomyObject], Any]:
    """The objects of a process, and their numbers, from 1 on, by those that its rows have."""
    objects = []
    numbers = np.zeros(len(table) + 1, np.uint32)
    for index, (kind, name, node) in enumerate(table.tolist()):
        # 0 until it is finished.
        if 0 < kind <= len(_OBJECT_KINDS):
            what = _OBJECT_KINDS[kind - 1]
            objects.append(
                AnatomyObject(process=process, kind=what, name=_text(name), node=_text(node))
            )
            numbers[index + 1] = len(objects)
    return objects, numbers


def _text(stored: bytes) -> str:
    """A name, which C ends with a zero."""
    return bytes(stored).split(b"\0")[0].decode(errors="replace")


_HINT = "Something else has written to the folder, or the disk is full; run the benchmark again."
