"""``ros2 bench`` is ``r2bspec``: asked as ros2cli asks its commands, and by ros2cli where it is."""

from __future__ import annotations

import argparse
import subprocess
import sys
import tomllib
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

import pytest

from command_line import Call, Said
from r2bspec._version import __version__
from r2bspec.cli.main import VERBS

ROOT = Path(__file__).parents[3]
RELAY = ROOT / "specs" / "relay.r2b.yaml"


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
        ["validate", RELAY],
        ["validate", "--format", "json", RELAY],
        ["plan", RELAY],
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


def test_alone_it_lists_the_verbs(capsys: pytest.CaptureFixture[str]) -> None:
    assert ros2("bench") == 0
    alone = capsys.readouterr().out
    with pytest.raises(SystemExit, match="^0$"):
        ros2("bench", "--help")
    assert capsys.readouterr().out == alone
    assert alone.startswith("usage: ros2 bench")
    assert all(f"\n  {verb} " in alone for verb in VERBS)


def test_it_has_the_version_of_r2bspec(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="^0$"):
        ros2("bench", "--version")
    assert capsys.readouterr().out == f"r2bspec {__version__}\n"


def test_ros2_has_the_command() -> None:
    pytest.importorskip("ros2cli", reason="ros2cli is in no wheel; source ROS 2")
    if "bench" not in {point.name for point in entry_points(group="ros2cli.command")}:
        pytest.skip("installed before the command was declared; install again")
    ros2_main = "import sys; from ros2cli.cli import main; sys.exit(main(argv=sys.argv[1:]))"
    command = [sys.executable, "-c", ros2_main, "bench", "validate", str(RELAY)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "1 file, no problems\n"), done.stderr
