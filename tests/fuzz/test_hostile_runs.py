"""Run folders, results and reports of strangers, read by the verbs that judge and compare."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from test_hostile_files import LONGEST_S, r2bspec

from run_simulation import Played, Simulation, objective

pytestmark = pytest.mark.timeout(4 * LONGEST_S)

DEEP = b'{"a":' * 100_000
EVERY_FILE = ("record.json", "plan.json", "monitor", "resources.npy")


def run_folder(path: Path) -> Path:
    Simulation(
        segments=[Played(10, [0.01, 0.02])],
        objectives={"fast": objective("latency.p99 < 60 ms", at="10 Hz")},
    ).write(path)
    return path


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _zeros(path: Path) -> None:
    path.symlink_to("/dev/zero")


def _itself(path: Path) -> None:
    path.symlink_to(path.name)


def _terabyte(path: Path) -> None:
    with path.open("wb") as stream:
        stream.truncate(10**12)


def replaced(folder: Path, name: str) -> Path:
    """The place of a file that was removed."""
    (file,) = list(folder.rglob(f"{name}*"))[:1]
    file.unlink()
    return file


@pytest.mark.parametrize("make", [_pipe, _zeros, _itself, _terabyte])
@pytest.mark.parametrize("name", EVERY_FILE)
def test_a_file_of_a_run_without_an_end_is_refused(
    name: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    folder = run_folder(tmp_path / "run")
    make(replaced(folder, name))
    status, said = r2bspec("judge", folder, cwd=tmp_path)
    assert status == 2, said
    assert "R2B650" in said


@pytest.mark.parametrize(
    "content", [DEEP, b"\xff", b"", b'{"r2bspec_record": "\xff"}', b"9" * 5000]
)
@pytest.mark.parametrize("name", ["record.json", "plan.json"])
def test_hostile_json_of_a_run_is_refused(name: str, content: bytes, tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    replaced(folder, name).write_bytes(content)
    status, said = r2bspec("judge", folder, cwd=tmp_path)
    assert status == 2, said
    assert "R2B650" in said


@pytest.mark.parametrize(
    "header",
    [
        b"[" * 9_000,
        b"(" * 9_000,
        b"-" * 9_000 + b"1",
        b"{'descr': '|O', 'fortran_order': False, 'shape': (1,)}",
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,)}",
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,)}",
        b"\xff" * 100,
    ],
    ids=["brackets", "parentheses", "minus", "objects", "large", "negative", "not UTF-8"],
)
def test_a_hostile_header_of_an_array_is_refused(header: bytes, tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    size = len(header).to_bytes(2, "little")
    replaced(folder, "monitor").write_bytes(b"\x93NUMPY\x01\x00" + size + header)
    status, said = r2bspec("judge", folder, cwd=tmp_path)
    assert status == 2, said
    assert "R2B650" in said


@pytest.mark.parametrize("make", [_pipe, _zeros, lambda path: path.write_bytes(b"\xff")])
def test_a_hostile_spec_of_a_run_is_refused(make: Callable[[Path], None], tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    make(replaced(folder, "spec.yaml"))
    status, said = r2bspec("report", folder, "--report", "html=a.html", cwd=tmp_path)
    assert status == 2, said
    assert "R2B650" in said


@pytest.mark.parametrize(
    "make", [_pipe, _zeros, _itself, _terabyte, lambda path: path.write_bytes(DEEP)]
)
@pytest.mark.parametrize("verb", ["import", "compare", "report"])
def test_a_hostile_result_or_report_is_refused(
    verb: str, make: Callable[[Path], None], tmp_path: Path
) -> None:
    file = tmp_path / "result.json"
    make(file)
    arguments = (file, file) if verb == "compare" else (file,)
    status, said = r2bspec(verb, *arguments, cwd=tmp_path)
    assert status == 2, said


def test_a_plan_that_is_a_pipe_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "plan.json")
    status, said = r2bspec("run", "plan.json", "--output", "out", cwd=tmp_path)
    assert status == 2, said
