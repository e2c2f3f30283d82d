"""Another process that holds the lock of this host."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from r2bspec.execute.processes.machine import DISABLED_BY

HOLDER = """
import sys
from r2bspec.execute.processes.machine import host_lock
with host_lock("the other one", on_wait=print):
    print("held", flush=True)
    sys.stdin.read()
"""


@contextmanager
def other_holder(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[subprocess.Popen[str]]:
    """Have the lock held until the process's standard input is closed, or it is killed.

    Args:
        folder: where the lock is, which is then of this test alone.
        monkeypatch: undoes that at the end of the test.
    """
    monkeypatch.setattr("tempfile.tempdir", str(folder))
    monkeypatch.delenv(DISABLED_BY)
    with subprocess.Popen(
        [sys.executable, "-c", HOLDER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"TMPDIR": str(folder)},
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
        process.kill()
