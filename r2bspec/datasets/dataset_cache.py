"""The cache of synthetic datasets: entries are created atomically, once for all processes."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from r2bspec.bags.errors import DATASET_NOT_WRITTEN, DataError

_SCRATCH_PREFIX = ".making-"
_LOCKS = ".locks"


def datasets_dir(cache_dir: Path | None = None) -> Path:
    """The folder of datasets: `cache_dir`, or the user's cache folder ($XDG_CACHE_HOME)."""
    if cache_dir is not None:
        return Path(cache_dir)
    import platformdirs

    return Path(platformdirs.user_cache_dir("r2bspec")) / "datasets"


@contextmanager
def entry_lock(root: Path, name: str) -> Iterator[None]:
    """Hold the lock of an entry; waits while another process creates it.

    The kernel releases the lock when its process exits.

    Raises:
        DataError: the cache cannot be written (R2B311).
    """
    from filelock import FileLock

    with write_errors(root):
        (root / _LOCKS).mkdir(parents=True, exist_ok=True)
        lock = FileLock(root / _LOCKS / f"{name}.lock")
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


@contextmanager
def new_entry(root: Path, name: str) -> Iterator[Path]:
    """A path for a new entry, which becomes the entry if the block succeeds.

    The caller holds the lock of the entry. If the block fails, its files are removed.

    Yields:
        A path that does not exist yet, named like the entry, on the same file system.
    """
    folder = root / f"{_SCRATCH_PREFIX}{name}"
    shutil.rmtree(folder, ignore_errors=True)
    try:
        with write_errors(root):
            folder.mkdir(parents=True)
        yield folder / name
        with write_errors(root):
            final = root / name
            if final.exists():
                # A damaged entry is moved away first, because only an empty folder can be replaced.
                final.rename(folder / "damaged")
            (folder / name).replace(final)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def remove_stale_entries(root: Path, locked_name: str) -> None:
    """Remove incomplete entries of killed processes.

    A process holds the lock of its entry, so a free lock means that it has exited.

    Args:
        root: the cache.
        locked_name: the entry whose lock the caller holds; `new_entry` clears that one.
    """
    from filelock import FileLock, Timeout

    for folder in root.glob(f"{_SCRATCH_PREFIX}*"):
        name = folder.name.removeprefix(_SCRATCH_PREFIX)
        if name == locked_name:
            continue
        with (
            suppress(Timeout, OSError),
            FileLock(root / _LOCKS / f"{name}.lock", timeout=0),
        ):
            shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def write_errors(root: Path) -> Iterator[None]:
    """Report a full or read-only disk as DataError (R2B311)."""
    import sqlite3

    try:
        yield
    except (OSError, sqlite3.Error) as error:
        errno = getattr(error, "errno", None)
        reason = str(error) if errno is None else os.strerror(errno)
        raise DataError(
            f"the dataset cannot be written to {root}: {reason}",
            code=DATASET_NOT_WRITTEN,
            hint="free space on this disk, or select another folder with XDG_CACHE_HOME",
        ) from error
