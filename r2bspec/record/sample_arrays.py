"""The samples of a run as NumPy arrays of fixed record types, and their files."""

from __future__ import annotations

import hashlib
import io
import os
from functools import cache, lru_cache
from pathlib import Path
from typing import Any, BinaryIO, Final, Literal

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from r2bspec.record.files import RecordError, write_atomically
from r2bspec.safe_io.limits import MAX_NUMBER, MAX_SAMPLES_BYTES
from r2bspec.safe_io.safe_file import TooLargeError, open_regular

Rows = NDArray[Any]
"""A one-dimensional array of one of the record types below."""

PLAYBACK_FIELDS = (
    ("stamp_ns", "<i8"),
    ("due_ns", "<i8"),
    ("published_ns", "<i8"),
    ("done_ns", "<i8"),
    ("inputs", "<i8"),
)
"""One row per step: the unique header stamp (system clock) of all inputs of the step; the times at
which publishing was due, at which it began, and at which the last input was published; and the
inputs of the plan of which the step has messages: bit k for input k, -1 for all of them. In a
timeline a step is due, and begins, with its first message."""

WORK_FIELDS = (("step", "<i8"), ("process", "<i8"), ("work_ns", "<i8"))
"""One row per step and process of the graph: the processor time that the process (an index into
`RunRecord.processes`) and its descendants used from when the step was due until the next step was
due. The last step of a playback has no row, nor has a step during which a process ended."""

MONITOR_FIELDS = (
    ("stamp_ns", "<i8"),
    ("received_ns", "<i8"),
    ("taken_ns", "<i8"),
    ("bytes", "<i8"),
)
"""One row per received message, in order of arrival: its header stamp (0 if the type has none), the
times at which the middleware received it and at which the monitor took it, and its serialised
size. Both times are equal where the middleware gives no time of reception."""

RESOURCE_FIELDS = (
    ("time_ns", "<i8"),
    ("process", "<i4"),
    ("cpu_s", "<f8"),
    ("memory_bytes", "<i8"),
    ("waited_s", "<f8"),
)
"""One row per process and sampling time: `process` indexes `RunRecord.processes`, with -1 for the
whole machine, -2 for the controller, and -3 for processes that carry the id of the run but descend
from no process of it that is known; `cpu_s` is the cumulative CPU time in seconds, summed over all
cores, the descendants of the process (for -2: without them), and those of them that have lost
their parents; `memory_bytes` is the resident set (for -1: memory in use); `waited_s` is the
cumulative run-queue wait of all threads: the time for which they could have run, but had no
processor. It is NaN for -1 and -2, and where the kernel does not count it."""

INTERFERENCE_FIELDS = (
    ("time_ns", "<i8"),
    ("busy_s", "<f8"),
    ("stolen_s", "<f8"),
    ("waited_s", "<f8"),
    ("throttled_s", "<f8"),
    ("cycles", "<f8"),
)
"""One row per sampling time. All values but the time are cumulative, and NaN if the system does not
provide them; those in seconds are the CPU time used on the cores that the run may use; their CPU
time taken by other virtual machines; the time in which some task waited for a CPU (PSI, ``some``);
the time in which the control group had used up its quota, or a core was throttled for heat.
`cycles` is the CPU time of each of these cores times its frequency at the sampling time; it is -1
in files of versions that did not record it."""

DEVICE_FIELDS = (
    ("time_ns", "<i8"),
    ("process", "<i4"),
    ("busy_s", "<f8"),
    ("encoder_s", "<f8"),
    ("decoder_s", "<f8"),
    ("gpu_j", "<f8"),
    ("package_j", "<f8"),
    ("gpu_bytes", "<f8"),
)
"""One row per sampling time, of the whole machine (-1), and of each process that was on a GPU, as
`process` of `RESOURCE_FIELDS`. The sums over all GPUs: the time for which they, their encoders and
their decoders were busy, and their energy in joules, all cumulative; and the memory in use.
`package_j` is the cumulative energy of the processor packages. NaN is what is not known; both
energies are so of a process."""

ANATOMY_FIELDS = (
    ("object", "<u4"),
    ("process", "<u4"),
    ("thread", "<u4"),
    ("kind", "<u2"),
    ("flags", "<u2"),
    ("began_ns", "<i8"),
    ("ended_ns", "<i8"),
    ("source_ns", "<i8"),
    ("received_ns", "<i8"),
    ("header_ns", "<i8"),
    ("clock_ns", "<i8"),
)
"""One row per event in a process that was observed from inside, in the order in which they began
(`r2bspec.record.run_record.AnatomyRecord`). `object` indexes its objects, from 1 on; 0 is none.
`process` indexes its processes. `thread` is the thread's id in the system. `kind` is an
`AnatomyKind`; bit 0 of `flags` says that a take took nothing, bit 1 that the publication or take
was within a process. `began_ns` and `ended_ns` are on the monotonic clock. `source_ns` is the stamp
that the middleware gave the message when it was published, and `received_ns` the one that it gave
it when it was received, both on the system clock; 0 where there is none. For services `source_ns`
is the sequence number, and for buffers within a process the index in the buffer. `header_ns` is
the header stamp of the message, or 0. `clock_ns` is the system clock less the monotonic clock."""

PLAYBACK_DTYPE: np.dtype[np.void] = np.dtype(list(PLAYBACK_FIELDS))
WORK_DTYPE: np.dtype[np.void] = np.dtype(list(WORK_FIELDS))
MONITOR_DTYPE: np.dtype[np.void] = np.dtype(list(MONITOR_FIELDS))
RESOURCE_DTYPE: np.dtype[np.void] = np.dtype(list(RESOURCE_FIELDS))
INTERFERENCE_DTYPE: np.dtype[np.void] = np.dtype(list(INTERFERENCE_FIELDS))
DEVICE_DTYPE: np.dtype[np.void] = np.dtype(list(DEVICE_FIELDS))
ANATOMY_DTYPE: np.dtype[np.void] = np.dtype(list(ANATOMY_FIELDS))

SampleKind = Literal[
    "playback", "work", "monitor", "anatomy", "resources", "interference", "devices"
]
DTYPES: Final[dict[SampleKind, np.dtype[np.void]]] = {
    "playback": PLAYBACK_DTYPE,
    "work": WORK_DTYPE,
    "monitor": MONITOR_DTYPE,
    "anatomy": ANATOMY_DTYPE,
    "resources": RESOURCE_DTYPE,
    "interference": INTERFERENCE_DTYPE,
    "devices": DEVICE_DTYPE,
}
"""The type of the rows of each kind of samples."""
OF_RUN: Final = frozenset[SampleKind]({"resources", "interference", "devices"})
"""Those of the whole run, and not of a segment."""


def sample_file(kind: SampleKind, monitor: str = "") -> str:
    """Return the name of the file of some samples; those of a monitor have its name."""
    return f"{kind}.{monitor}.npy" if monitor else f"{kind}.npy"


def write_rows(path: Path, rows: Rows, dtype: np.dtype[np.void]) -> str:
    """Write rows atomically to an ``.npy`` file, and return the SHA-256 of its content.

    Raises:
        ValueError: `rows` is not one-dimensional or not of type `dtype`.
        RecordError: the file cannot be written.
    """
    if rows.ndim != 1 or rows.dtype != dtype:
        raise ValueError(f"{path.name}: expected rows of {dtype}, not {rows.ndim}-d {rows.dtype}")
    buffer = io.BytesIO()
    npy_format.write_array(buffer, rows, allow_pickle=False)
    content = buffer.getvalue()
    write_atomically(path, content)
    return hashlib.sha256(content).hexdigest()


def read_rows(path: Path, dtype: np.dtype[np.void], sha256: str = "") -> Rows:
    """Read rows of type `dtype` from an ``.npy`` file; pickles are not allowed.

    Args:
        path: the path of the file.
        dtype: the dtype of a row.
        sha256: of its content; empty if that is not known.

    Raises:
        RecordError: the file is missing, cannot be read, is another one, or does not contain
            one-dimensional rows of `dtype`.
    """
    try:
        with open_regular(path) as file:
            _limit_size(file)
            content = file.read()
    except FileNotFoundError as error:
        raise RecordError(f"{path} is missing", hint=_HINT) from error
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror}", hint=_HINT) from error
    if sha256 and hashlib.sha256(content).hexdigest() != sha256:
        raise RecordError(
            f"{path} is damaged: these are not the samples that the run wrote", hint=_HINT
        )
    try:
        start = _LENGTH_AT + 2 + int.from_bytes(content[_LENGTH_AT : _LENGTH_AT + 2], "little")
        shape, stored = _parse_header(content[:start])
        rows: Rows = np.frombuffer(content, stored, offset=start).reshape(shape).copy()
    except Exception as error:
        # NumPy parses headers as Python: what is wrong with one shows in any error of a parser.
        raise RecordError(f"{path} is damaged: {error}", hint=_HINT) from error
    if rows.ndim != 1 or rows.dtype != dtype:
        raise RecordError(f"{path} is damaged: it has no {path.stem} rows", hint=_HINT)
    _check_values(rows, path)
    return rows


LONGEST_NS = 1 << 62
"""Differences of times within this (146 years) are 64-bit integers, too."""


@cache
def _has_integers_alone(dtype: np.dtype[Any]) -> bool:
    return all(dtype[name] == np.int64 for name in dtype.names or ("",))


def _check_values(rows: Rows, path: Path) -> None:
    if rows.size and _has_integers_alone(rows.dtype):
        # Nearly always no value is large, whatever it means: a run has thousands of files.
        values = rows.view(np.int64)
        if values.min() >= -LONGEST_NS and values.max() <= LONGEST_NS:
            return
    names = [name for name in rows.dtype.names or () if name.endswith("_ns")] if rows.size else ()
    for name in names:
        times = rows[name]
        if times.min() < -LONGEST_NS or times.max() > LONGEST_NS:
            raise RecordError(f"{path} is damaged: {name} has an impossible time", hint=_HINT)
    for name in rows.dtype.names or ():
        # NaN is what the system does not count; it counts processor time.
        size = np.abs(rows[name]) if rows.dtype[name].kind == "f" else np.zeros(0)
        if np.any(~(size <= MAX_NUMBER) if name == "cpu_s" else size > MAX_NUMBER):
            raise RecordError(f"{path} is damaged: {name} has an impossible value", hint=_HINT)


_LENGTH_AT = npy_format.MAGIC_LEN


@lru_cache(maxsize=256)
def _parse_header(header: bytes) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Return the shape and the type of an array; a run has thousands of files with few headers.

    Args:
        header: version 1.0 of the format, the only one that `write_rows` writes.
    """
    file = io.BytesIO(header)
    if npy_format.read_magic(file) != (1, 0):
        raise ValueError("it is not of version 1.0 of the format")
    shape, _, stored = npy_format.read_array_header_1_0(file)
    if any(length < 0 for length in shape) or stored.hasobject:
        raise ValueError("it has no rows of numbers")
    return shape, stored


def _limit_size(file: BinaryIO) -> None:
    if os.fstat(file.fileno()).st_size > MAX_SAMPLES_BYTES:
        raise TooLargeError(f"it is larger than {MAX_SAMPLES_BYTES:,} bytes")


_HINT = "The run folder is incomplete or was changed after the run; run the benchmark again."
