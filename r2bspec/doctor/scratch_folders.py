"""Scratch folders that killed runs have left, and datasets that were never finished."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Set
from pathlib import Path

from r2bspec.datasets.dataset_cache import datasets_dir
from r2bspec.doctor.checkup import System

_MIN_AGE_S = 10.0
"""A run makes its folder a moment before the processes by which it can be known to live."""


def abandoned_scratch(system: System, living: Set[str]) -> list[Path]:
    """Scratch folders of dead runs, in the folder of runs or in the run folder that it is."""
    folders = [*system.runs.glob("*/.scratch-*"), *system.runs.glob(".scratch-*")]
    return sorted(each for each in folders if _is_old(each) and _run_id(each.parent) not in living)


def unfinished_datasets(cache: Path | None = None) -> list[Path]:
    """What was being made in the cache of datasets by processes that are gone.

    Whoever makes a dataset holds its lock, so one whose lock can be had is nobody's.
    """
    root = cache or datasets_dir()
    return sorted(each for each in root.glob(".making-*") if _is_old(each) and _is_free(root, each))


def _is_old(folder: Path) -> bool:
    try:
        return time.time() - folder.stat().st_mtime > _MIN_AGE_S
    except OSError:
        return False


def _run_id(folder: Path) -> str:
    """The run that a folder belongs to; empty if its record cannot be read."""
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError):
        return str(json.loads((folder / "record.json").read_bytes())["run_id"])
    return ""


def _is_free(root: Path, folder: Path) -> bool:
    from filelock import FileLock, Timeout

    name = folder.name.removeprefix(".making-")
    try:
        with FileLock(root / ".locks" / f"{name}.lock", timeout=0):
            return True
    except (Timeout, OSError):
        return False
