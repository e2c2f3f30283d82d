"""The cache of datasets: its size, and the free space of its disk."""

from __future__ import annotations

import contextlib
import shutil
from pathlib import Path

from r2bspec.datasets.dataset_cache import datasets_dir
from r2bspec.doctor.checkup import CheckResult, System
from r2bspec.measure.units import show

TOPIC = "datasets"

_MIN_FREE_BYTES = 4 << 30
"""The size of a few seconds of all topics of the largest synthetic dataset."""


def check_datasets(system: System, cache: Path | None = None) -> list[CheckResult]:
    """Check the cache, and the folder of recorded datasets if R2B_DATASETS is set."""
    checks = [_cache(cache or datasets_dir())]
    named = system.environ.get("R2B_DATASETS")
    if named and not Path(named).is_dir():
        checks.append(
            CheckResult(
                topic=TOPIC,
                name="recorded",
                status="problem",
                found=f"R2B_DATASETS is {named}, which is not a folder",
                advice="correct it, or unset it to use synthetic datasets",
            )
        )
    return checks


def _cache(folder: Path) -> CheckResult:
    entries = [each for each in _entries(folder) if not each.name.startswith(".")]
    size = sum(_size(each) for each in entries)
    free = shutil.disk_usage(_nearest_existing_folder(folder)).free
    data = {"path": str(folder), "entries": len(entries), "bytes": size, "free_bytes": free}
    used = f"{show(size, 'B')} in {len(entries)} datasets" if entries else "empty"
    too_little = free < _MIN_FREE_BYTES
    return CheckResult(
        topic=TOPIC,
        name="cache",
        status="warn" if too_little else "ok",
        found=f"{used}, {show(free, 'B')} free; {folder}",
        advice="remove synthetic datasets, which are created again when needed, "
        "or select another disk with XDG_CACHE_HOME"
        if too_little
        else "",
        data=data,
    )


def _entries(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []


def _size(path: Path) -> int:
    """The bytes of a file, or of all files in a folder; files that disappear count 0."""
    total = 0
    for each in (path, *path.rglob("*")):
        with contextlib.suppress(OSError):
            total += each.stat().st_size if each.is_file() else 0
    return total


def _nearest_existing_folder(folder: Path) -> Path:
    """The nearest existing parent, which is on the same disk."""
    return next(each for each in (folder, *folder.parents) if each.exists())
