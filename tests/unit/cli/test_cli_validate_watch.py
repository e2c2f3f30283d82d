"""``r2bspec validate --watch``: every change of a file that a spec reads is checked."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from r2bspec.cli.main import main
from r2bspec.untrusted.looked_up_files import looked_up_files
from r2bspec.untrusted.safe_file import is_there, read_text

BASE = """\
name: relay
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: camera/image}}
playback: {inputs: {input: {from: camera/image, format: sensor_msgs/msg/Image}}}
graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode}}}
monitors: {copies: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [10 Hz]}
"""


class Watch:
    """A process of `validate --watch` on a folder."""

    def __init__(self, folder: Path) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-m", "r2bspec", "validate", "--watch", str(folder)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def summary(self) -> tuple[str, str]:
        """What it prints next: the findings, and the line at the end of a check."""
        assert self.process.stdout is not None
        findings = ""
        while not (line := self.process.stdout.readline()).split(" file")[0].isdigit():
            assert line, self.process.communicate()
            findings += line
        return findings, line.rstrip("\n")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    specs = tmp_path / "specs"
    specs.mkdir()
    (specs / "base.yaml").write_text(BASE)
    (specs / "one.r2b.yaml").write_text("r2bspec: 1\nextends: base.yaml\n")
    return specs


@pytest.fixture
def watch(folder: Path) -> Iterator[Watch]:
    started = Watch(folder)
    yield started
    started.process.kill()
    started.process.communicate()


def replace(file: Path, text: str) -> None:
    """As editors save: a new file takes the place of the old one."""
    new = file.with_suffix(".new")
    new.write_text(text)
    new.rename(file)


def test_changes_of_specs_and_of_what_they_extend(folder: Path, watch: Watch) -> None:
    assert watch.summary() == ("", "1 file, no problems")
    replace(folder / "one.r2b.yaml", "r2bspec: 1\nextends: base.yaml\ntitel: x\n")
    findings, said = watch.summary()
    assert "error[R2B101 unknown-key]: unknown key 'titel'" in findings
    assert said.startswith("1 file, 1 error, 0 warnings")
    replace(folder / "one.r2b.yaml", "r2bspec: 1\nextends: base.yaml\n")
    assert watch.summary() == ("", "1 file, no problems")
    replace(folder / "base.yaml", BASE.replace("10 Hz", "10 Hx"))
    findings, _ = watch.summary()
    assert "base.yaml:6" in findings
    replace(folder / "base.yaml", BASE)
    assert watch.summary() == ("", "1 file, no problems")
    # A spec that is new, and one that is gone.
    replace(folder / "two.r2b.yaml", "r2bspec: 1\nname: two\nextends: base.yaml\n")
    assert watch.summary() == ("", "2 files, no problems")
    (folder / "one.r2b.yaml").unlink()
    assert watch.summary() == ("", "1 file, no problems")
    watch.process.send_signal(signal.SIGINT)
    assert watch.process.wait(60) == 130


def test_it_prints_text_for_people_only(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for options in (["--format", "json"], ["--fix"], ["--diff"], ["--resolved"]):
        assert main(["validate", "--watch", str(folder), *options]) == 2
    assert main(["validate", "--watch", "-"]) == 2
    assert capsys.readouterr().err.count("--watch prints findings as text") == 5


def test_lookups_are_noted_with_the_state_before_the_file_was_read(tmp_path: Path) -> None:
    there, missing = tmp_path / "there", tmp_path / "missing"
    there.write_text("a")
    before = there.stat()
    with looked_up_files() as seen:
        read_text(there, max_bytes=10)
        there.write_text("longer")
        read_text(there, max_bytes=10)
        assert not is_there(missing)
    read_text(there, max_bytes=10)
    stamp = (before.st_mtime_ns, before.st_size, before.st_ino, before.st_ctime_ns)
    assert seen.files == {str(there): stamp, str(missing): None}
