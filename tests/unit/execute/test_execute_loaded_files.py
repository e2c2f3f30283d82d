"""What processes of a graph have loaded: what they map, and what programs in Python name."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from r2bspec.execute.identity.loaded_files import LoadedFiles
from r2bspec.record.run_record import ProcessRecord


@pytest.fixture
def program() -> Iterator[subprocess.Popen[bytes]]:
    """A program in Python that runs."""
    command = [sys.executable, "-c", "print(flush=True); input()"]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
        process.kill()


@pytest.mark.parametrize(
    ("names", "complete", "noted"),
    [
        (["/user/gains.py"], True, False),
        ([], True, True),
        # A run that failed has killed its processes.
        ([], False, False),
    ],
)
def test_a_program_that_names_nothing_is_noted(
    tmp_path: Path,
    program: subprocess.Popen[bytes],
    names: list[str],
    complete: bool,
    noted: bool,
) -> None:
    notes: list[str] = []
    loaded = LoadedFiles(cast("Any", None), notes.append, tmp_path)
    loaded.look((), [cast("Any", SimpleNamespace(name="blur", pid=program.pid))])
    if names:
        (tmp_path / f"{program.pid}-7").write_bytes("\0".join(names).encode())
    records = [
        ProcessRecord(name=name, role="command", pid=pid, exit_code=0)
        for name, pid in (("blur", program.pid), ("compiled", 1))
    ]
    files = loaded.by_process(records, complete=complete)
    assert str(Path(sys.executable).resolve()) in files["blur"]
    assert {*names} <= files["blur"]
    sentence = "blur did not say which modules of Python it had imported"
    assert notes == ([sentence] if noted else [])
