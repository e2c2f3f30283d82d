"""``r2bspec validate`` of many files, and of files that change."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

import r2bspec.cli.check_files as check_files_module
from command_line import Call
from data_bags import chatter, write_bag
from example_spec import example
from r2bspec.api import InvalidSpecError, prepare
from r2bspec.cli.check_files import CheckOptions, check_files

# ``r2bspec validate --watch``: every change of a file that a spec reads is checked.


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


NAMES_FILES = """\
r2bspec: 1
name: names_files
data_loader: {bag: ./bag, topics: {/ping: words}}
playback: {inputs: {input: {from: words, format: std_msgs/msg/String}}}
graph: {nodes: {relay: {python: "./relay.py:Relay", parameters: [parameters.yaml]}}}
monitors: {copies: {topic: output, format: std_msgs/msg/String, match: order}}
benchmark: {rates: [10 Hz]}
"""
RELAY = """\
from rclpy.node import Node
from std_msgs.msg import String


class Relay(Node):
    def __init__(self, **options):
        super().__init__("relay", **options)
        self.create_subscription(String, "input", print, 10)
        self.create_publisher(String, "output", 10)
"""


def test_changes_of_everything_that_a_spec_names(folder: Path, watch: Watch) -> None:
    """What is new to tell is printed once, and nothing else is."""
    assert watch.summary() == ("", "1 file, no problems")
    write_bag(folder / "bag", chatter())
    (folder / "relay.py").write_text(RELAY)
    (folder / "parameters.yaml").write_text("/**: {ros__parameters: {}}\n")
    # Nothing looks at these yet; the folder is not what a spec depends on.
    (folder / "notes.txt").write_text("x")
    replace(folder / "two.r2b.yaml", NAMES_FILES)
    findings, said = watch.summary()
    assert " 0 errors" in said or said == "2 files, no problems", findings
    replace(folder / "relay.py", RELAY.replace('"output"', '"other"'))
    assert "R2B2" in watch.summary()[0]
    replace(folder / "relay.py", RELAY)
    assert watch.summary() == (findings, said)
    (folder / "relay.py").unlink()
    assert "error[R2B624" in watch.summary()[0]
    replace(folder / "relay.py", RELAY)
    assert watch.summary() == (findings, said)
    # A file that was looked for, and was not there.
    (folder / "interfaces").mkdir()
    replace(folder / "interfaces" / "relay.yaml", "wrong\n")
    assert "interface" in watch.summary()[0]
    (folder / "interfaces" / "relay.yaml").unlink()
    assert watch.summary() == (findings, said)
    replace(folder / "parameters.yaml", "- wrong\n")
    assert "parameters.yaml" in watch.summary()[0]
    replace(folder / "parameters.yaml", "/**: {ros__parameters: {}}\n")
    assert watch.summary() == (findings, said)
    (folder / "bag").rename(folder / "elsewhere")
    assert "error[R2B301" in watch.summary()[0]
    (folder / "elsewhere").rename(folder / "bag")
    assert watch.summary() == (findings, said)
    # The specs are gone, and back.
    (folder / "two.r2b.yaml").unlink()
    assert watch.summary() == ("", "1 file, no problems")
    watch.process.send_signal(signal.SIGINT)
    output, errors = watch.process.communicate(timeout=60)
    assert (watch.process.returncode, output, errors.strip()) == (130, "", "interrupted")


def test_it_prints_text_for_people_only(folder: Path, call: Call) -> None:
    for options in (["--format", "json"], ["--fix"], ["--diff"], ["--resolved"], ["-"]):
        ended = call("validate", "--watch", folder, *options, status=2)
        assert "--watch prints findings as text" in ended.err


# Many files: shared out among processes, with the results of one process, in its order.


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    names = []
    for number in range(40):
        file = tmp_path / f"{number}.r2b.yaml"
        rate = "30 Hz" if number % 3 else number
        file.write_text(example(benchmark=f"{{rates: [{rate}]}}"))
        names.append(str(file))
    return names


def test_several_processes_say_what_one_says(
    files: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = list(check_files(files, CheckOptions(offline=True, resolved=True)))
    monkeypatch.setattr(check_files_module, "MIN_PARALLEL_FILES", 2)
    monkeypatch.setattr("os.sched_getaffinity", lambda _: {0, 1})
    together = list(check_files(files, CheckOptions(offline=True, resolved=True)))
    assert together == alone
    assert [each.file for each in together] == files
    assert sum(not each.complete for each in together) == 14


def test_a_waiver_holds_for_every_case_of_a_matrix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, call: Call
) -> None:
    """It is used if one case needs it, though another does not."""
    monkeypatch.chdir(tmp_path)
    document = example(
        variables="{size: 1}",
        matrix="{axes: {size: [1, 20]}}",
        playback="{inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}},"
        " buffer: $(var size)}",
    )
    waiver = "# r2bspec: ignore[R2B323] on purpose"
    Path("a.r2b.yaml").write_text(document)
    assert "R2B323" in call("validate", "a.r2b.yaml").out
    Path("a.r2b.yaml").write_text(document.replace("playback:", f"{waiver}\nplayback:"))
    assert call("validate", "a.r2b.yaml", status=0).out == "1 file, 2 cases, no problems\n"


def test_what_is_waived_can_be_run(tmp_path: Path) -> None:
    file = tmp_path / "a.r2b.yaml"
    document = example(
        playback="{inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}, buffer: 1}"
    )
    file.write_text(document)
    assert [diagnostic.code for diagnostic in prepare(file).diagnostics] == ["R2B323"]
    file.write_text(
        document.replace("buffer: 1}", "buffer: 1} # r2bspec: ignore[R2B323] on purpose")
    )
    assert prepare(file).diagnostics == ()


def test_what_makes_the_document_unusable_stays_an_error(tmp_path: Path) -> None:
    file = tmp_path / "a.r2b.yaml"
    document = example(benchmark="{rates: [30]}").rstrip()
    file.write_text(f"{document} # r2bspec: ignore[R2B109] on purpose\n")
    (checked,) = check_files([str(file)], CheckOptions())
    assert {finding.code for finding in checked.findings} == {"R2B109", "R2B043"}
    with pytest.raises(InvalidSpecError) as caught:
        prepare(file)
    assert {diagnostic.code for diagnostic in caught.value.diagnostics} == {"R2B109", "R2B043"}
