"""What a user sees without rclpy, or with a middleware that is not installed; real processes."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from r2bspec.middleware.middleware import RMW_VARIABLE

ROOT = Path(__file__).parents[3]
SPEC = ROOT / "specs" / "relay.r2b.yaml"

MAIN = """
import sys
sys.path[:0] = sys.argv[1:3]
from r2bspec.cli.main import main
sys.exit(main(sys.argv[3:]))
"""


def without_rclpy(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The command line, with all packages of this interpreter but those of ROS."""
    packages = folder / "packages"
    packages.mkdir()
    for place in map(Path, sys.path):
        if place.name in {"site-packages", "dist-packages"}:
            for each in place.iterdir():
                if not each.name.startswith("rclpy") and not (packages / each.name).exists():
                    (packages / each.name).symlink_to(each)
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [sys.executable, "-S", "-P", "-c", MAIN, str(ROOT), str(packages), *words],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )


def test_run_says_that_rclpy_is_missing_before_it_reads_any_data(tmp_path: Path) -> None:
    done = without_rclpy(tmp_path, "run", str(SPEC), "--output", "out")
    assert done.returncode == 2
    assert "error[R2B620 ros-not-installed]: rclpy is not installed\n" in done.stderr
    assert "help: Source a ROS 2 installation, or pip install 'r2bspec[ros]'." in done.stderr
    assert "reading" not in done.stderr
    assert "run folder: out" in done.stderr
    assert "Traceback" not in done.stderr


def test_doctor_names_a_middleware_that_is_not_installed(tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    done = subprocess.run(
        [sys.executable, "-m", "r2bspec", "doctor"],
        cwd=tmp_path,
        env=os.environ | {RMW_VARIABLE: "rmw_absent_cpp", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 1
    [line] = [each for each in done.stdout.splitlines() if "✘ rclpy" in each]
    assert "rmw_absent_cpp" in line
    # Of a message of rcl, what is for its developers is left out.
    assert not any(each in line for each in ("[ERROR]", ".c:", "JSON"))
    assert f"→ rmw_absent_cpp is not installed: install it, or unset {RMW_VARIABLE}" in done.stdout
