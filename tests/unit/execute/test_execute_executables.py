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


@pytest.mark.parametrize(
    ("command", "message", "code"),
    [
        ("$(executable apriltag_ros node)", "'apriltag_ros' is not installed in 1", "R2B622"),
        ("$(executable demo_nodes_cpp speaker)", "no executable 'speaker'", "R2B623"),
        # A file that may not be executed, and a folder.
        ("$(executable demo_nodes_cpp readme)", "no executable 'readme'", "R2B623"),
        ("$(executable demo_nodes_cpp plugins)", "no executable 'plugins'", "R2B623"),
        ("no-such-program", "program 'no-such-program' is not on PATH", "R2B621"),
    ],
)
def test_what_is_not_installed_is_named(
    prefix: Path, command: str, message: str, code: str
) -> None:
    (prefix / "lib/demo_nodes_cpp/readme").write_text("text")
    (prefix / "lib/demo_nodes_cpp/plugins").mkdir()
    with pytest.raises(NotInstalledError, match=message) as raised:
        resolve_argv(process(command))
    assert (raised.value.code, raised.value.exit_code) == (code, 2)
    if code == "R2B623":
        assert raised.value.hint == "Its executables: listener, talker."


def test_a_program_is_looked_up_on_the_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "node"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert resolve_argv(process("node", "$HOME", "*")) == [str(program), "$HOME", "*"]
    assert resolve_argv(process("./node", "a b")) == ["./node", "a b"]
    assert resolve_argv(process("$(python)", "-m", "x")) == [sys.executable, "-m", "x"]
