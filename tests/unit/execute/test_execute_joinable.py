"""Which programs the harness can join, told from the program itself."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

from elf_files import elf_file
from r2bspec.execute.bringup.harness_processes import Hello, is_target_process
from r2bspec.execute.errors import NotJoinableError
from r2bspec.execute.processes.elf import require_joinable, why_not_joinable

FOREIGN_USER = 65534
OWN_MACHINE = int.from_bytes(Path(sys.executable).read_bytes()[18:20], "little")


def elf(folder: Path, *segments: tuple[int, bytes], machine: int = OWN_MACHINE) -> Path:
    """A program of a header and segments, each a type and its content."""
    path = folder / "program"
    path.write_bytes(elf_file(*segments, machine=machine))
    path.chmod(0o755)
    return path


GLIBC = (3, b"/lib64/ld-linux-x86-64.so.2\0")
LOADED = (1, b"code")


def test_a_program_with_a_dynamic_linker_can_be_joined(tmp_path: Path) -> None:
    assert why_not_joinable(elf(tmp_path, LOADED, GLIBC)) == ""
    assert why_not_joinable(Path(sys.executable)) == ""


@pytest.mark.parametrize(
    ("segments", "reason"),
    [
        ([LOADED], "is linked statically"),
        ([(3, b"/lib/ld-musl-x86_64.so.1\0")], "uses another C library than ROS (musl)"),
    ],
)
def test_one_without_it_or_with_another_cannot(
    tmp_path: Path, segments: list[tuple[int, bytes]], reason: str
) -> None:
    assert why_not_joinable(elf(tmp_path, *segments)) == reason


@pytest.mark.skipif(os.getuid() != 0, reason="only root can give a program to another user")
def test_a_program_of_another_user_cannot_be_joined_nor_what_it_starts(tmp_path: Path) -> None:
    program = tmp_path / "setuid"
    shutil.copy(Path(sys.executable).resolve(), program)
    os.chown(program, FOREIGN_USER, -1)
    program.chmod(0o755)
    require_joinable("node", [str(program), sys.executable])
    program.chmod(0o4755)
    with pytest.raises(NotJoinableError, match="another user"):
        require_joinable("node", [str(program), sys.executable])


def hello(*arguments: str, executable: str = "/usr/bin/python3.11") -> Hello:
    return Hello(pid=1, process="node", executable=executable, arguments=arguments)


@pytest.mark.parametrize(
    ("asking", "program", "meant"),
    [
        (hello("/opt/demo/talker", executable="/opt/demo/talker"), "", True),
        (hello("python3", "node.py"), "", True),
        (hello("python3", "/opt/ros/jazzy/bin/ros2", "run", "demo", "talker"), "", False),
        (hello("/usr/bin/python3", "/opt/ros/jazzy/bin/ros2", "launch", "a.py"), "", False),
        (hello("/opt/demo/talker", executable="/opt/demo/talker"), "talker", True),
        (hello("/opt/demo/other", executable="/opt/demo/other"), "talker", False),
        (hello("/opt/demo/other", "--ros-args", "-r", "__node:=talker"), "talker", True),
    ],
)
def test_a_node_is_told_from_what_starts_it(asking: Hello, program: str, meant: bool) -> None:
    assert is_target_process(asking, program) is meant
