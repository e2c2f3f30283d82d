"""How the file of a Python node is imported: as a module of its package, or as a script is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

_PROGRAM = """\
import sys
from pathlib import Path
from r2bspec.harness.node_main import NodeError, find_factory
try:
    print(find_factory(sys.argv[1], Path(sys.argv[2]))())
except NodeError as error:
    print(error)
"""


def imported(target: str, folder: Path) -> str:
    """What the function of a file returns; in a process of its own, as for a run."""
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, target, str(folder)],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """The folder of a spec in a repository as colcon has it."""
    package = tmp_path / "src" / "camera" / "camera"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "cost.py").write_text("WORK = 21\n")
    folder = tmp_path / "bench"
    folder.mkdir()
    return folder


def test_a_file_imports_the_modules_of_its_package(bench: Path) -> None:
    (bench.parent / "src/camera/camera/node.py").write_text(
        "from camera.cost import WORK as whole\nfrom .cost import WORK as relative\n"
        "from cost import WORK as beside\n"
        "def make():\n    return f'{__name__} {whole} {relative} {beside}'\n"
    )
    assert imported("../src/camera/camera/node.py:make", bench) == "camera.node 21 21 21"


def test_a_file_beside_the_spec_imports_those_beside_it(bench: Path) -> None:
    (bench / "helper.py").write_text("WORK = 1\n")
    (bench / "node.py").write_text("from helper import WORK\ndef make():\n    return WORK\n")
    assert imported("./node.py:make", bench) == "1"


def test_another_package_of_the_same_name_is_named(bench: Path) -> None:
    package = bench.parent / "src" / "camera" / "json"
    package.mkdir()
    (package / "__init__.py").touch()
    (package / "node.py").write_text("def make():\n    return 1\n")
    message = imported("../src/camera/json/node.py:make", bench)
    assert message.startswith("cannot import node.py: ")
    assert "json.node" in message
