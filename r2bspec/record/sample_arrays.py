"""The samples of a run as NumPy arrays of fixed record types, and their files."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.lib import format as npy_format
from numpy.typing import NDArray

from r2bspec.record.files import RecordError, write_atomically
from r2bspec.record.run_record import (
    INTERFERENCE_FIELDS,
    MONITOR_FIELDS,
    PLAYBACK_FIELDS,
    RESOURCE_FIELDS,
)
from r2bspec.safe_io.limits import MAX_SAMPLES_BYTES
from r2bspec.safe_io.safe_file import TooLargeError, open_regular

Rows = NDArray[Any]
"""A one-dimensional array of one of the record types below."""

PLAYBACK_DTYPE: np.dtype[np.void] = np.dtype(list(PLAYBACK_FIELDS))
MONITOR_DTYPE: np.dtype[np.void] = np.dtype(list(MONITOR_FIELDS))
RESOURCE_DTYPE: np.dtype[np.void] = np.dtype(list(RESOURCE_FIELDS))
INTERFERENCE_DTYPE: np.dtype[np.void] = np.dtype(list(INTERFERENCE_FIELDS))


def write_rows(path: Path, rows: Rows, dtype: np.dtype[np.void]) -> None:
    """Write rows atomically to an ``.npy`` file.

    Raises:
        ValueError: `rows` is not one-dimensional or not of type `dtype`.
        RecordError: the file cannot be written.
    """
    if rows.ndim != 1 or rows.dtype != dtype:
        raise ValueError(f"{path.name}: expected rows of {dtype}, not {rows.ndim}-d {rows.dtype}")

    def save(file: BinaryIO) -> None:
        npy_format.write_array(file, rows, allow_pickle=False)

    write_atomically(path, save)


def read_rows(path: Path, dtype: np.dtype[np.void]) -> Rows:
    """Read rows of type `dtype` from an ``.npy`` file; pickles are not allowed.

    Trailing fields that are missing, because an older version wrote the file, are -1.

    Raises:
        RecordError: the file is missing or truncated, has data after its end, or does not contain
            one-dimensional rows of `dtype`.
    """
    try:
        with open_regular(path) as file:
            if os.fstat(file.fileno()).st_size > MAX_SAMPLES_BYTES:
                raise TooLargeError(f"it is larger than {MAX_SAMPLES_BYTES:,} bytes")
            rows: Rows = npy_format.read_array(file, allow_pickle=False)
            whole = not file.read(1)
    except FileNotFoundError as error:
        raise RecordError(f"{path} is missing", hint=_HINT) from error
    except Exception as error:
        # NumPy parses headers as Python: what is wrong with one shows in any error of a parser.
        raise RecordError(f"{path} is damaged: {error}", hint=_HINT) from error
    if whole and rows.ndim == 1 and rows.dtype != dtype:
        rows = _with_missing_fields(rows, dtype)
    if not whole or rows.ndim != 1 or rows.dtype != dtype:
        raise RecordError(f"{path} is damaged: it has no {path.stem} rows", hint=_HINT)
    return rows


def _with_missing_fields(rows: Rows, dtype: np.dtype[np.void]) -> Rows:
    """Rows extended to all fields of a type, if they have its first ones; else unchanged."""
    names = rows.dtype.names or ()
    wanted = dtype.names or ()
    if not names or wanted[: len(names)] != names:
        return rows
    if any(rows.dtype[name] != dtype[name] for name in names):
        return rows
    extended = np.full(rows.size, -1, dtype)
    for name in names:
        extended[name] = rows[name]
    return extended


_HINT = "The run folder is incomplete or was changed after the run; run the benchmark again."
