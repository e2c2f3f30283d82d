"""Run folders, results and reports of strangers, read by the verbs that judge and compare."""

from __future__ import annotations

import json
import resource
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hostile_calls import LONGEST_S, answered, make_special, small_run

from r2bspec.judge.measure.host_usage import ProcessSamples
from r2bspec.record.sample_arrays import RESOURCE_DTYPE
from run_simulation import renew_digests

pytestmark = pytest.mark.timeout(4 * LONGEST_S)

DEEP = b'{"a":' * 100_000


def replaced(folder: Path, name: str) -> Path:
    """The place of a file that was removed."""
    (file,) = list(folder.rglob(f"{name}*"))[:1]
    file.unlink()
    return file


@pytest.mark.parametrize("kind", ["pipe", "zeros", "itself", "terabyte"])
@pytest.mark.parametrize("name", ["record.json", "plan.json", "monitor", "resources.npy"])
def test_a_file_of_a_run_without_an_end_is_refused(name: str, kind: str, tmp_path: Path) -> None:
    folder = small_run(tmp_path / "run")
    make_special(replaced(folder, name), kind)
    answered("judge", folder, cwd=tmp_path, says="R2B650")


@pytest.mark.parametrize(
    "content", [DEEP, b"\xff", b"", b'{"r2bspec_record": "\xff"}', b"9" * 5000]
)
@pytest.mark.parametrize("name", ["record.json", "plan.json"])
def test_hostile_json_of_a_run_is_refused(name: str, content: bytes, tmp_path: Path) -> None:
    folder = small_run(tmp_path / "run")
    replaced(folder, name).write_bytes(content)
    answered("judge", folder, cwd=tmp_path, says="R2B650")


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
    folder = small_run(tmp_path / "run")
    size = len(header).to_bytes(2, "little")
    replaced(folder, "monitor").write_bytes(b"\x93NUMPY\x01\x00" + size + header)
    renew_digests(folder)
    answered("judge", folder, cwd=tmp_path, says="R2B650")


@pytest.mark.parametrize("kind", ["pipe", "zeros", "not UTF-8"])
def test_a_hostile_spec_of_a_run_is_refused(kind: str, tmp_path: Path) -> None:
    folder = small_run(tmp_path / "run")
    file = replaced(folder, "spec.yaml")
    file.write_bytes(b"\xff") if kind == "not UTF-8" else make_special(file, kind)
    answered("report", folder, "--report", "html=a.html", cwd=tmp_path, says="R2B650")


@pytest.mark.parametrize("kind", ["pipe", "zeros", "itself", "terabyte", "deep"])
@pytest.mark.parametrize(
    "words",
    [
        *("import @", "compare @ @", "report @", "judge @", "plan @", "run @ --output out"),
        *("data info @", "history list --file @"),
    ],
)
def test_a_hostile_file_is_refused_by_every_verb(words: str, kind: str, tmp_path: Path) -> None:
    file = tmp_path / "result.json"
    file.write_bytes(DEEP) if kind == "deep" else make_special(file, kind)
    answered(*words.replace("@", file.name).split(), cwd=tmp_path, status=(2, 4))


@pytest.mark.parametrize(
    ("processes", "listed", "says"),
    [
        (100_000, 0, "INCONCLUSIVE"),
        (100_000, 100_000, "length <= 10000"),
        (9_000, 9_000, "the limit is 100,000"),
    ],
    ids=["unknown", "listed", "in many segments"],
)
def test_processes_without_number_take_no_time(
    processes: int, listed: int, says: str, tmp_path: Path
) -> None:
    """Each process takes its time in each segment; those that the record lacks take none."""
    folder = small_run(tmp_path / "run", segments=12)
    record = json.loads((folder / "record.json").read_text())
    file = folder / "resources.npy"
    rows = np.load(file)
    ends = rows[rows["process"] == 0][[0, -1]]
    forged = np.tile(ends, processes)
    forged["process"] = np.repeat(np.arange(processes), 2)
    np.save(file, forged)
    if listed:
        one = record["processes"][0]
        record["processes"] = [{**one, "name": f"p{number}"} for number in range(listed)]
        (folder / "record.json").write_text(json.dumps(record))
    renew_digests(folder)
    answered("judge", folder, cwd=tmp_path, status=(0, 2, 3), says=says)


def test_windows_are_counted_as_they_are_calculated() -> None:
    rng = np.random.default_rng(1)
    rows = np.zeros(60, RESOURCE_DTYPE)
    rows["process"] = rng.integers(-2, 12, 60)
    rows["time_ns"] = rng.integers(0, 1_000, 60)
    samples = ProcessSamples(rows)
    began = rng.integers(0, 1_000, 40)
    ended = began + rng.integers(0, 300, 40)
    calculated = sum(
        len(samples.used(int(begin), int(end))) for begin, end in zip(began, ended, strict=True)
    )
    alone = np.unique(rows["process"], return_counts=True)[1] == 1
    assert calculated <= samples.count_windows(began, ended) <= calculated + 40 * alone.sum()


@pytest.mark.parametrize("mebibytes", [80, 150, 250, 383])
def test_address_space_that_numpy_does_not_fit_into_is_named(
    mebibytes: int, tmp_path: Path
) -> None:
    small_run(tmp_path / "run")
    for words in (("judge", "run"), ("report", "run", "--report", "html=page.html")):
        ended = subprocess.run(
            [sys.executable, "-P", "-m", "r2bspec", *words],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            preexec_fn=lambda: resource.setrlimit(
                resource.RLIMIT_AS, (mebibytes << 20, mebibytes << 20)
            ),
        )
        assert ended.returncode == 2, ended
        assert f"limited to {mebibytes}" in ended.stderr
        assert "ulimit -v" in ended.stderr
    assert not (tmp_path / "page.html").exists()
