"""From the command line in a plan to a program on this machine."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from r2bspec.execute.errors import NotInstalledError
from r2bspec.execute.processes.prerequisites import find_executable, resolve_argv
from r2bspec.plan.plan import ProcessPlan


def process(*argv: str) -> ProcessPlan:
    return ProcessPlan(name="talker", role="command", phase="measure", argv=argv, env={})


def install(prefix: Path, package: str, *executables: str) -> Path:
    """Install a package as ament does."""
    index = prefix / "share/ament_index/resource_index/packages"
    index.mkdir(parents=True, exist_ok=True)
    (index / package).touch()
    folder = prefix / "lib" / package
    folder.mkdir(parents=True, exist_ok=True)
    for name in executables:
        (folder / name).write_text("#!/bin/sh\n")
        (folder / name).chmod(0o755)
    return prefix


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    found = install(tmp_path / "install", "demo_nodes_cpp", "talker", "listener")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(found))
    return found


def test_an_executable_of_a_package_is_found(prefix: Path) -> None:
    argv = resolve_argv(process("$(executable demo_nodes_cpp talker)", "--ros-args", "-r", "a:=b"))
    assert argv == [str(prefix / "lib/demo_nodes_cpp/talker"), "--ros-args", "-r", "a:=b"]


def test_the_first_prefix_that_has_it_wins(
    tmp_path: Path, prefix: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    overlay = install(tmp_path / "overlay", "demo_nodes_cpp", "talker")
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{overlay}:{prefix}")
    assert find_executable("demo_nodes_cpp", "talker") == overlay / "lib/demo_nodes_cpp/talker"
    # The overlay has the package, too, but not this executable.
    assert find_executable("demo_nodes_cpp", "listener") == prefix / "lib/demo_nodes_cpp/listener"


def test_a_package_that_is_not_installed_is_named(prefix: Path) -> None:
    with pytest.raises(NotInstalledError, match="'apriltag_ros' is not installed") as raised:
        resolve_argv(process("$(executable apriltag_ros node)"))
    assert raised.value.code == "R2B622"
    assert raised.value.exit_code == 2


def test_without_a_sourced_workspace_no_package_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    with pytest.raises(NotInstalledError, match="in 0 ament prefixes"):
        find_executable("demo_nodes_cpp", "talker")


def test_an_executable_that_the_package_lacks_is_answered_with_those_it_has(prefix: Path) -> None:
    with pytest.raises(NotInstalledError, match="no executable 'speaker'") as raised:
        find_executable("demo_nodes_cpp", "speaker")
    assert raised.value.code == "R2B623"
    assert raised.value.hint == "Its executables: listener, talker."


def test_a_file_that_may_not_be_executed_is_no_executable(prefix: Path) -> None:
    (prefix / "lib/demo_nodes_cpp/readme").write_text("text")
    with pytest.raises(NotInstalledError, match="no executable 'readme'"):
        find_executable("demo_nodes_cpp", "readme")


def test_a_folder_is_no_executable(prefix: Path) -> None:
    (prefix / "lib/demo_nodes_cpp/plugins").mkdir()
    with pytest.raises(NotInstalledError, match="no executable 'plugins'") as raised:
        find_executable("demo_nodes_cpp", "plugins")
    assert "plugins" not in raised.value.hint


def test_the_interpreter_is_the_one_that_runs_r2bspec() -> None:
    assert resolve_argv(process("$(python)", "-m", "x")) == [sys.executable, "-m", "x"]


def test_a_program_is_looked_up_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "node"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert resolve_argv(process("node", "$HOME", "*")) == [str(program), "$HOME", "*"]


def test_a_program_that_is_not_there_is_named() -> None:
    with pytest.raises(
        NotInstalledError, match="program 'no-such-program' is not on PATH"
    ) as raised:
        resolve_argv(process("no-such-program"))
    assert raised.value.code == "R2B621"
    assert raised.value.exit_code == 2


def test_a_path_is_left_as_it_is() -> None:
    assert resolve_argv(process("./node", "a b")) == ["./node", "a b"]
