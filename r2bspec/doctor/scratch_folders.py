"""Scratch folders of killed runs, and datasets that were not completed."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Set
from pathlib import Path

from r2bspec.datasets.dataset_cache import datasets_dir
from r2bspec.doctor.checkup import System

_MIN_AGE_S = 10.0
"""A run creates its folder shortly before the processes that mark it as active."""


def abandoned_scratch(system: System, living: Set[str]) -> list[Path]:
    """Scratch folders of ended runs; `system.runs` is a folder of runs or a run folder."""
    folders = [*system.runs.glob("*/.scratch-*"), *system.runs.glob(".scratch-*")]
    return sorted(each for each in folders if _is_old(each) and _run_id(each.parent) not in living)


def unfinished_datasets(cache: Path | None = None) -> list[Path]:
    """Incomplete datasets in the cache whose process has exited.

    A process holds the lock of the dataset that it creates, so a free lock means that it exited.
    """
    root = cache or datasets_dir()
    return sorted(each for each in root.glob(".making-*") if _is_old(each) and _is_free(root, each))


def _is_old(folder: Path) -> bool:
    try:
        return time.time() - folder.stat().st_mtime > _MIN_AGE_S
    except OSError:
        return False


def _run_id(folder: Path) -> str:
    """The run of a folder; empty if its record cannot be read."""
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
