"""One array of an .npz archive: its size is limited, and nothing in it is executed."""

from __future__ import annotations

import math
import zipfile
import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from r2bspec.untrusted.errors import RefusedDataError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

MAX_ARRAY_BYTES: Final = 64 << 20
"""An image of 4,000 by 4,000 pixels of four bytes."""

_MAX_HEADER_BYTES: Final = 10_000


def read_npz_array(path: Path, name: str) -> NDArray[Any]:
    """Read one array.

    Args:
        path: of the archive.
        name: of the array, without ``.npy``.

    Raises:
        KeyError: there is no such array.
        RefusedDataError: the archive is damaged, or the array is too large or has no plain numbers.
        OSError: the system refuses.
    """
    try:
        with zipfile.ZipFile(path) as archive, archive.open(f"{name}.npy") as stream:
            return _read_array(stream)
    except (zipfile.BadZipFile, zlib.error, ValueError, EOFError, NotImplementedError) as error:
        raise RefusedDataError(f"{path}: the array {name} is damaged: {error}") from error


def _read_array(stream: Any) -> NDArray[Any]:
    import numpy as np

    version = np.lib.format.read_magic(stream)
    if version != (1, 0):
        raise ValueError(f"version {version} of its header is not known")
    shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(
        stream, max_header_size=_MAX_HEADER_BYTES
    )
    wanted = _checked_bytes(dtype, shape)
    content = stream.read(wanted)
    if len(content) != wanted:
        raise ValueError(f"it has {len(content):,} of {wanted:,} bytes")
    flat = np.frombuffer(content, dtype)
    return flat.reshape(shape[::-1]).T if is_fortran else flat.reshape(shape)


def _checked_bytes(dtype: np.dtype[Any], shape: tuple[int, ...]) -> int:
    """The size of an array of plain numbers."""
    if dtype.hasobject or dtype.kind not in "biuf":
        raise ValueError(f"its type {dtype} is no number")
    size = math.prod(shape) * dtype.itemsize
    if not 0 < size <= MAX_ARRAY_BYTES:
        raise ValueError(f"it states {size:,} bytes; {MAX_ARRAY_BYTES:,} are allowed")
    return size
