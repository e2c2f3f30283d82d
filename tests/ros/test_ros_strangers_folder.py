"""Promise: no process of r2bspec imports a module of the current folder, in a run or an inspection.

Only what the spec names is executed: nothing in the specs of these tests is a file of the folder.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from ros_runs import Bench, relay_spec

DEPENDENCIES = {
    *("click", "yaml", "numpy", "msgspec", "rich", "psutil", "scipy", "rosbags", "filelock"),
    *("rclpy", "rcl_interfaces", "sensor_msgs", "std_msgs", "launch", "launch_ros"),
    *("ament_index_python", "sitecustomize", "usercustomize"),
}


def stranger(folder: Path, marker: Path) -> None:
    """Give a folder a module of every name that Python or r2bspec could look for."""
    # For `python -m`, Python itself imports these two before any line of r2bspec is executed.
    names = set(sys.stdlib_module_names) - {"contextlib", "importlib"} | DEPENDENCIES
    for name in names:
        (folder / f"{name}.py").write_text(
            f"with open({str(marker)!r}, 'a') as file: file.write(__name__ + '\\n')\n"
            "raise SystemExit('the module of a stranger')\n",
            encoding="utf-8",
        )


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("strangers") / "checkout")
    stranger(found.folder, found.folder.parent / "imported")
    return found


def assert_nothing_imported(bench: Bench) -> None:
    marker = bench.folder.parent / "imported"
    assert not marker.exists(), marker.read_text()


def test_a_run_imports_nothing_from_the_current_folder(bench: Bench) -> None:
    bench.run(relay_spec()).assert_complete()
    assert_nothing_imported(bench)


def test_an_inspection_imports_nothing_from_the_current_folder(bench: Bench) -> None:
    spec = bench.write(relay_spec())
    done = subprocess.run(
        [sys.executable, "-m", "r2bspec", "interfaces", spec.name],
        cwd=bench.folder,
        capture_output=True,
        text=True,
        timeout=180,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert (bench.folder / "interfaces" / "relay.yaml").is_file()
    assert_nothing_imported(bench)


def test_a_module_of_a_stranger_would_be_noticed(bench: Bench) -> None:
    subprocess.run([sys.executable, "-c", "import yaml"], cwd=bench.folder, check=False)
    marker = bench.folder.parent / "imported"
    assert marker.read_text() == "yaml\n"
    marker.unlink()
