"""`r2bspec validate --fix` and `--diff`, as a user calls them."""

from __future__ import annotations

import functools
import os
import subprocess
from pathlib import Path

import pytest

from command_line import Call
from example_spec import example

BROKEN = (
    example(benchmark="{rates: [30, 20hz]} # in Hz").replace("\n", "\r\n")
    + "# the end, without a line end"
)
REPAIRED = BROKEN.replace("[30, 20hz]", "[30 Hz, 20 Hz]")


@pytest.fixture
def spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = Path("a.r2b.yaml")
    file.write_bytes(BROKEN.encode())
    file.chmod(0o640)
    return file


@pytest.fixture
def validate(call: Call) -> Call:
    return functools.partial(call, "validate", "--offline")


def test_fix_keeps_all_but_the_mistake_and_has_nothing_to_do_again(
    spec: Path, validate: Call
) -> None:
    _, out, err = validate("--fix", spec, status=0)
    assert spec.read_bytes().decode() == REPAIRED
    before = spec.stat()
    assert before.st_mode & 0o777 == 0o640
    assert out.startswith("1 file, no problems")
    assert err == "2 problems repaired in 1 of 1 files\n"
    assert os.listdir() == ["a.r2b.yaml"]
    assert validate("--fix", spec, status=0).err == "0 problems repaired in 0 of 1 files\n"
    after = spec.stat()
    assert (after.st_mtime_ns, after.st_ino) == (before.st_mtime_ns, before.st_ino)


def test_fix_reports_what_is_left(spec: Path, validate: Call) -> None:
    spec.write_text(example(benchmark="{rates: [30], iterations: -1}"))
    assert "error[R2B107 number-out-of-range]" in validate("--fix", spec, status=1).out
    assert "rates: [30 Hz], iterations: -1" in spec.read_text()


def test_fix_follows_a_link_and_keeps_it(spec: Path, validate: Call) -> None:
    link = Path("b.r2b.yaml")
    link.symlink_to(spec)
    validate("--fix", link, status=0)
    assert link.is_symlink()
    assert spec.read_bytes().decode() == REPAIRED


@pytest.mark.parametrize("name", ["elsewhere/c.r2b.yaml", "step.r2b.yaml"])
def test_fix_does_not_write_through_a_link_to_another_folder(
    spec: Path, validate: Call, name: str
) -> None:
    target = Path("elsewhere/c.r2b.yaml")
    target.parent.mkdir()
    target.write_bytes(BROKEN.encode())
    # The second link is in the folder, and leads on.
    Path("step.r2b.yaml").symlink_to(target)
    link = Path("b.r2b.yaml")
    link.symlink_to(name)
    error = validate("--fix", link, status=2).err
    assert target.read_bytes() == BROKEN.encode()
    assert link.is_symlink()
    assert "is a link to" in error
    assert "in another folder" in error


def test_diff_writes_nothing_and_can_be_applied(spec: Path, validate: Call) -> None:
    _, out, err = validate("--diff", spec, status=1)
    assert spec.read_bytes().decode() == BROKEN
    assert out.startswith("--- a/a.r2b.yaml\n+++ b/a.r2b.yaml\n")
    assert err == "2 problems can be repaired by --fix in 1 of 1 files\n"
    subprocess.run(["git", "apply", "-"], input=out.encode(), check=True)  # noqa: S607
    assert spec.read_bytes().decode() == REPAIRED
    assert validate("--diff", spec, status=0).out == ""


def test_a_file_that_cannot_be_written(spec: Path, validate: Call) -> None:
    if os.geteuid() == 0:
        pytest.skip("root may write everywhere")
    Path().chmod(0o500)
    try:
        error = validate("--fix", spec, status=2).err
    finally:
        Path().chmod(0o700)
    assert "error[R2B601 wrong-usage]: a.r2b.yaml cannot be written" in error
