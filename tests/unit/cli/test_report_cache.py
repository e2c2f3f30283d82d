"""``r2bspec validate`` keeps reports, and shows none of what has changed since."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from data_bags import chatter, write_bag
from r2bspec.cli import check_files as check_files_module
from r2bspec.cli import report_cache
from r2bspec.cli.check_files import check_files
from r2bspec.cli.file_report import CheckOptions, FileReport
from r2bspec.cli.main import main
from r2bspec.cli.report_cache import ReportCache

ROOT = Path(__file__).parents[3]

BASE = """\
title: with all that a spec can name
environment: [R2BSPEC_TEST_RATE]
data_loader: {bag: ./bag, topics: {/ping: words}}
playback: {inputs: {input: {from: words, format: std_msgs/msg/String}}}
graph:
  nodes:
    relay:
      python: ./relay.py:Relay
      parameters: [parameters.yaml]
      remappings: {output: copies}
    module: {python: r2bspec_test_module.Node}
    program: {command: [r2bspec-test-program], publishes: {more: std_msgs/msg/String}}
    packaged: {package: r2bspec_test_package, executable: camera}
monitors: {copies: {topic: copies, format: std_msgs/msg/String}}
benchmark: {rates: [$(env R2BSPEC_TEST_RATE)]}
slos: {same: {require: [latency.p50 <= 102 % of baseline]}}
"""
RELAY = """\
from rclpy.node import Node
from std_msgs.msg import String


class Relay(Node):
    def __init__(self):
        super().__init__("relay")
        self.create_subscription(String, "input", print, 10)
        self.create_publisher(String, "output", 10)
"""
INTERFACE = """\
r2bspec_interface: 1
subscribes: {input: std_msgs/msg/String}
publishes: {output: std_msgs/msg/String}
"""


class Workplace:
    """A spec with everything that it names, and its reports."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.folder = folder / "specs"
        self.prefix = folder / "ros"
        self.programs = folder / "bin"
        self.site = folder / "site"
        for each in (self.folder, self.prefix, self.programs, self.site):
            each.mkdir()
        write_bag(self.folder / "bag", chatter())
        self.write("base.yaml", BASE)
        self.write("relay.py", RELAY)
        self.write("parameters.yaml", "/**: {ros__parameters: {depth: 3}}\n")
        self.spec = self.write("one.r2b.yaml", "r2bspec: 1\nname: one\nextends: base.yaml\n")
        monkeypatch.setenv("R2BSPEC_TEST_RATE", "10 Hz")
        monkeypatch.setenv("AMENT_PREFIX_PATH", str(self.prefix))
        monkeypatch.setenv("PATH", str(self.programs), prepend=os.pathsep)
        monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        monkeypatch.delenv("R2BSPEC_NO_CACHE")
        monkeypatch.syspath_prepend(self.site)
        self.cache = folder / "cache" / "r2bspec" / "reports"
        self.checked: list[str] = []
        before = check_files_module.check_file

        def counted(file: str, options: CheckOptions) -> FileReport:
            self.checked.append(file)
            return before(file, options)

        monkeypatch.setattr(check_files_module, "check_file", counted)

    def write(self, name: str, text: str) -> Path:
        file = self.folder / name
        file.parent.mkdir(exist_ok=True)
        file.write_text(text)
        return file

    def report(self, options: CheckOptions | None = None, *, kept: bool) -> FileReport:
        """The report of the spec; whether it was kept from before is as expected."""
        self.checked.clear()
        options = options or CheckOptions()
        files = [str(self.spec)]
        (found,) = check_files(files, options, ReportCache.of_check(files, options))
        assert self.checked == ([] if kept else files)
        return found

    def fresh(self) -> FileReport:
        (found,) = check_files([str(self.spec)], CheckOptions())
        return found


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Workplace:
    # What has just been written is not kept otherwise.
    monkeypatch.setattr(report_cache, "_SETTLED_NS", 0)
    return Workplace(tmp_path, monkeypatch)


def replaced(file: Path, text: str) -> None:
    """As most editors save."""
    new = file.with_name("new")
    new.write_text(text)
    new.rename(file)


def edited_in_place(file: Path, old: str, new: str) -> None:
    """With the same length, and the same modification time afterwards."""
    assert len(old) == len(new)
    before = file.stat()
    text = file.read_text()
    assert old in text
    with file.open("r+") as stream:
        stream.write(text.replace(old, new))
    os.utime(file, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert (file.stat().st_mtime_ns, file.stat().st_size) == (before.st_mtime_ns, before.st_size)


def installed(place: Workplace) -> None:
    index = place.prefix / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True)
    (index / "r2bspec_test_package").touch()


def program(place: Workplace) -> None:
    (place.programs / "r2bspec-test-program").write_text("#!/bin/sh\n")
    (place.programs / "r2bspec-test-program").chmod(0o755)


def another_bag(place: Workplace) -> None:
    shutil.rmtree(place.folder / "bag")
    write_bag(
        place.folder / "bag", [("/other", offset_ns, data) for _, offset_ns, data in chatter()]
    )


def link_out_of_the_folder(place: Workplace) -> None:
    outside = place.folder.parent / "base.yaml"
    outside.write_text(BASE)
    (place.folder / "base.yaml").unlink()
    (place.folder / "base.yaml").symlink_to(outside)


CHANGES: dict[str, Callable[[Workplace], object]] = {
    "spec": lambda place: replaced(place.spec, place.spec.read_text() + "titel: x\n"),
    "spec, same time": lambda place: edited_in_place(place.spec, "name: one", "nime: one"),
    "parent": lambda place: replaced(place.folder / "base.yaml", BASE.replace("[$(", "[5 Hx, $(")),
    "parent, same time": lambda place: edited_in_place(
        place.folder / "base.yaml", "monitors", "monitros"
    ),
    "parent is gone": lambda place: (place.folder / "base.yaml").unlink(),
    "parent is a link": link_out_of_the_folder,
    "Python file": lambda place: edited_in_place(place.folder / "relay.py", '"output"', '"outpet"'),
    "Python file is gone": lambda place: (place.folder / "relay.py").unlink(),
    "parameter file": lambda place: replaced(place.folder / "parameters.yaml", "wrong\n"),
    "interface that was not there": lambda place: place.write(
        "interfaces/relay.yaml", INTERFACE.replace("output", "others")
    ),
    "bag": another_bag,
    "bag is gone": lambda place: shutil.rmtree(place.folder / "bag"),
    "noise that was not there": lambda place: place.write("one.noise.json", "{"),
    "module that was not there": lambda place: (place.site / "r2bspec_test_module.py").touch(),
    "package that was not there": installed,
    "program that was not there": program,
}


@pytest.mark.parametrize("change", CHANGES)
def test_a_change_is_seen(change: str, place: Workplace) -> None:
    before = place.report(kept=False)
    assert place.report(kept=True) == before
    CHANGES[change](place)
    after = place.report(kept=False)
    assert after == place.fresh()
    # It is something that the report depends on.
    assert after.findings != before.findings
    assert place.report(kept=True) == after


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("R2BSPEC_TEST_RATE", "10 Hx"),
        ("R2BSPEC_TEST_RATE", None),
        ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp"),
        ("R2BSPEC_LABELS", "robot=carter"),
        ("ROS_DISTRO", "humble"),
        ("PATH", "/nowhere"),
        ("AMENT_PREFIX_PATH", None),
    ],
)
def test_a_variable_that_changes_is_seen(
    name: str, value: str | None, place: Workplace, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = place.report(kept=False)
    place.report(kept=True)
    monkeypatch.setenv("R2BSPEC_SOMETHING_ELSE", "1")
    assert place.report(kept=True) == before
    if value is None:
        monkeypatch.delenv(name)
    else:
        monkeypatch.setenv(name, value)
    assert place.report(kept=False) == place.fresh()


def test_options_and_the_program_have_reports_of_their_own(
    place: Workplace, monkeypatch: pytest.MonkeyPatch
) -> None:
    place.report(kept=False)
    for options in (
        CheckOptions(offline=True),
        CheckOptions(sets=("benchmark.rates=[5 Hz]",)),
        CheckOptions(allow_paths=(place.folder.parent,)),
    ):
        place.report(options, kept=False)
        place.report(options, kept=True)
    place.report(kept=True)
    monkeypatch.setattr(report_cache, "__version__", "0.0.1")
    place.report(kept=False)


def test_what_may_not_be_settled_is_not_kept(
    place: Workplace, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file system whose clock stands still gives two versions the same stamp."""
    monkeypatch.setattr(report_cache, "_SETTLED_NS", 3_600_000_000_000)
    place.report(kept=False)
    place.report(kept=False)


def test_what_changes_while_it_is_checked_is_not_kept(
    place: Workplace, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = check_files_module.check_file

    def changing(file: str, options: CheckOptions) -> FileReport:
        found = before(file, options)
        replaced(place.spec, place.spec.read_text() + "titel: x\n")
        return found

    with monkeypatch.context() as patch:
        patch.setattr(check_files_module, "check_file", changing)
        place.report(kept=False)
    assert place.report(kept=False) == place.fresh()


@pytest.mark.parametrize(
    "damage",
    [
        lambda content: content[: len(content) // 2],
        lambda content: content.replace(b"one.r2b", b"two.r2b"),
        lambda content: content[:0],
        lambda content: b"\xff" * len(content),
    ],
)
def test_damaged_files_of_the_cache_are_ignored(
    place: Workplace, damage: Callable[[bytes], bytes]
) -> None:
    before = place.report(kept=False)
    (file,) = place.cache.iterdir()
    assert file.stat().st_mode & 0o077 == 0
    file.write_bytes(damage(file.read_bytes()))
    assert place.report(kept=False) == before
    assert place.report(kept=True) == before


def test_a_cache_that_cannot_be_written_is_none(
    place: Workplace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(place.spec))
    place.report(kept=False)
    place.report(kept=False)


def test_old_files_are_removed(place: Workplace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(report_cache, "_MAX_FILES", 2)
    for number in range(4):
        place.report(CheckOptions(sets=(f"benchmark.rates=[{number + 1} Hz]",)), kept=False)
    assert len([*place.cache.iterdir()]) == 2
    place.report(CheckOptions(sets=("benchmark.rates=[4 Hz]",)), kept=True)


def test_the_number_of_reports_is_limited(
    place: Workplace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(report_cache, "_MAX_REPORTS", 2)
    place.report(kept=False)
    files = [str(shutil.copy(place.spec, place.folder / f"{name}.r2b.yaml")) for name in "abc"]
    for file in files:
        assert [*check_files([file], CheckOptions(), ReportCache.of_check([file], CheckOptions()))]
    cache = ReportCache(CheckOptions())
    assert [cache.get(file) is not None for file in (str(place.spec), *files)] == [
        False,
        False,
        True,
        True,
    ]


def test_known_and_new_reports_come_in_the_order_of_the_files(place: Workplace) -> None:
    names = [place.folder / f"{name}.r2b.yaml" for name in "fedcba"]
    for each in names:
        shutil.copy(place.spec, each)
    some = [str(each) for each in names[1::2]]
    assert (
        len([*check_files(some, CheckOptions(), ReportCache.of_check(some, CheckOptions()))]) == 3
    )
    files = [*map(str, names)]
    cache = ReportCache.of_check(files, CheckOptions())
    place.checked.clear()
    assert [each.file for each in check_files(files, CheckOptions(), cache)] == files
    assert place.checked == [str(each) for each in names[::2]]


def test_the_command_line(place: Workplace, capsys: pytest.CaptureFixture[str]) -> None:
    said = []
    for options in ([], [], ["--no-cache"], ["--format", "json"]):
        place.checked.clear()
        main(["validate", str(place.spec), *options])
        said.append(capsys.readouterr().out)
        assert len(place.checked) == (options == ["--no-cache"] or len(said) == 1)
    assert said[0] == said[1] == said[2]
    assert '"findings"' in said[3]
    for options in (["--diff"], ["--resolved"]):
        place.checked.clear()
        main(["validate", str(place.spec), *options])
        assert options == ["--diff"] or place.checked == [str(place.spec)]


def test_nothing_of_the_compiler_is_imported_for_what_is_known(place: Workplace) -> None:
    """The second check of a spec starts much faster than the first."""
    place.spec.write_text((ROOT / "specs" / "apriltag_node.r2b.yaml").read_text())
    code = (
        "import sys; from r2bspec.cli.main import main; main(['validate', sys.argv[1]]); "
        "print(sorted(each for each in sys.modules if each.startswith('r2bspec.check')))"
    )
    newest_ns = max(each.stat().st_ctime_ns for each in place.folder.rglob("*"))
    while time.time_ns() < newest_ns + 2 * 100_000_000:
        time.sleep(0.01)
    answers = []
    for _ in range(2):
        ran = subprocess.run(
            [sys.executable, "-c", code, str(place.spec)],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        )
        *shown, modules = ran.stdout.splitlines()
        answers.append((shown, modules))
    assert answers[0][0] == answers[1][0]
    assert "r2bspec.check.engine" in answers[0][1]
    assert answers[1][1] == "[]"
