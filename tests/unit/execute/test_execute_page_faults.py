"""Page faults of a process, from the kernel."""

from __future__ import annotations

import mmap
import os
from pathlib import Path

import pytest

from r2bspec.execute.processes import resources


def test_touching_fresh_memory_is_counted() -> None:
    before = resources.minor_faults(os.getpid())
    with mmap.mmap(-1, 64 * mmap.PAGESIZE) as fresh:
        for at in range(0, len(fresh), mmap.PAGESIZE):
            fresh[at] = 1
    assert resources.minor_faults(os.getpid()) > before > 0


def test_those_of_children_that_have_ended_belong_to_it(monkeypatch: pytest.MonkeyPatch) -> None:
    stat = b"7 (a (strange) name) S 1 7 7 0 -1 4194560 120 30 2 1 5 6 0 0\n"
    monkeypatch.setattr(Path, "read_bytes", lambda _: stat)
    assert resources.minor_faults(7) == 150


def test_a_process_that_is_gone_has_none() -> None:
    assert resources.minor_faults(2**22 + 1) == 0
