"""What a user sees without rclpy, or by way of ``ros2 bench``."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import pytest

from command_line import Call, Said

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
    assert "help: Source a ROS 2 installation, or pip install '" in done.stderr
    assert "reading" not in done.stderr
    assert "run folder: out" in done.stderr
    assert "Traceback" not in done.stderr


# ``ros2 bench`` is ``r2bspec``: asked as ros2cli asks its commands, and by ros2cli where it is.


def declared() -> dict[str, EntryPoint]:
    """The commands for ros2cli, as the package declares them."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    group = "ros2cli.command"
    points = project["entry-points"][group].items()
    return {name: EntryPoint(name, value, group) for name, value in points}


def ros2(*words: str) -> int:
    """What ros2cli 0.32 does with ``ros2 WORDS``: a parser for each command, and two calls."""
    root = argparse.ArgumentParser("ros2")
    commands: Any = root.add_subparsers(dest=" _command")
    for name, point in declared().items():
        extension = point.load()()
        parser = commands.add_parser(name, formatter_class=argparse.RawDescriptionHelpFormatter)
        parser.set_defaults(_command=extension)
        parser.description = extension.__doc__.splitlines()[0].rstrip(".")
        extension.add_arguments(parser, f"ros2 {name}")
    args = root.parse_args(words)
    status: int = args._command.main(parser=root, args=args)
    return status


@pytest.mark.parametrize(
    "words",
    [
        ["validate", SPEC],
        ["validate", "--format", "json", SPEC],
        ["plan", SPEC],
        ["run", "--help"],
        ["judge", "nowhere"],
        ["compare", "nowhere", "elsewhere"],
        ["run", "nowhere.r2b.yaml", "--no-such-option"],
        ["frobnicate"],
    ],
    ids=lambda words: " ".join(map(str, words[:2])).replace(str(ROOT), ""),
)
def test_it_says_what_r2bspec_says(
    words: list[object], call: Call, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = call(*words)
    assert Said(ros2("bench", *map(str, words)), *capsys.readouterr()) == asked
    assert asked.out or asked.err


def test_ros2_has_the_command() -> None:
    pytest.importorskip("ros2cli", reason="ros2cli is in no wheel; source ROS 2")
    if "bench" not in {point.name for point in entry_points(group="ros2cli.command")}:
        pytest.skip("installed before the command was declared; install again")
    ros2_main = "import sys; from ros2cli.cli import main; sys.exit(main(argv=sys.argv[1:]))"
    command = [sys.executable, "-c", ros2_main, "bench", "validate", str(SPEC)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "1 file, no problems\n"), done.stderr
