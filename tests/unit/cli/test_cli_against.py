"""Ways to compare on the command line: which exclude each other, and what is no base."""

from __future__ import annotations

import os
from pathlib import Path

import click
import pytest

from r2bspec.cli.main import command as r2bspec
from r2bspec.cli.spec_selection import SpecSelection, base_selection
from r2bspec.compare.base_reference import BadReferenceError, parse_base_reference
from r2bspec.execute.processes.environment import (
    applied_environment,
    inherited_environment,
    workspace_environment,
    workspace_environments,
)


@pytest.mark.parametrize(
    "arguments",
    [
        "run s --resume",
        "compare s --against var:a=1 --control",
        "compare s --pairs 0 --control",
        "compare s --case all --against var:a=1",
        "compare s",
        "compare s t u",
        "compare s t --control",
        "compare s t --format markdown",
        "compare runs/1.json",
        "compare runs/1.json runs/2.json --pairs 3",
        "fleet run s",
        "fleet run s --on a --pairs 3",
        "fleet run s --on a --smoke --against var:a=1",
    ],
)
def test_options_that_exclude_each_other_are_wrong_usage(arguments: str) -> None:
    with pytest.raises(click.UsageError):
        r2bspec.main(arguments.split(), standalone_mode=False)


@pytest.mark.parametrize("text", ["nothing.r2b.yaml", "main", "var:", "var:x", "set:=3", ""])
def test_what_is_no_base_is_said_with_a_way_out(text: str) -> None:
    with pytest.raises(BadReferenceError) as caught:
        parse_base_reference([text])
    assert (caught.value.exit_code, bool(caught.value.hint)) == (2, True)


def test_a_stored_run_is_no_base_and_the_way_out_is_told(tmp_path: Path) -> None:
    (tmp_path / "record.json").touch()
    with pytest.raises(BadReferenceError) as caught:
        parse_base_reference([str(tmp_path)])
    assert "r2bspec compare" in caught.value.hint


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("env:API_TOKEN=abc=d", "env:API_TOKEN=***"),
        ("env:OMP_NUM_THREADS=4", "env:OMP_NUM_THREADS=4"),
        ("env:/opt/KEY/setup.bash", "env:/opt/KEY/setup.bash"),
        ("var:token=abc", "var:token=abc"),
    ],
)
def test_a_reference_is_shown_without_secrets_of_the_environment(text: str, shown: str) -> None:
    found = parse_base_reference([text, "set:a.b=1"])
    assert found.text == f"{shown}, set:a.b=1"
    assert "".join(found.environments) in text


def test_the_base_has_what_the_head_was_given(tmp_path: Path) -> None:
    head = SpecSelection(Path("a"), ("x=1",), {"v": "1", "w": "1"}, "threads=2", ())
    base = base_selection(head, parse_base_reference(["var:v=2", "set:y=2"]))
    assert (base.spec, base.sets, base.case) == (Path("a"), ("x=1", "y=2"), "threads=2")
    assert base.variables == {"v": "2", "w": "1"}
    other = tmp_path / "b"
    other.touch()
    alone = base_selection(head, parse_base_reference([str(other)]))
    assert (alone.spec, alone.sets, alone.variables, alone.case) == (other, (), {}, "")


class TestEnvironments:
    def test_a_setup_file_is_sourced(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("AMENT_PREFIX_PATH", "/under")
        monkeypatch.setenv("GONE", "1")
        (tmp_path / "setup.bash").write_text(
            'echo hello\nexport AMENT_PREFIX_PATH="/base:$AMENT_PREFIX_PATH"\nunset GONE\n'
            "export MULTI=$'a\\nb'\n"
        )
        for text in (str(tmp_path), str(tmp_path / "setup.bash")):
            found = workspace_environment(text)
            assert found["AMENT_PREFIX_PATH"] == "/base:/under"
            assert (found["GONE"], found["MULTI"]) == ("", "a\nb")
            assert found.keys() <= {"AMENT_PREFIX_PATH", "GONE", "MULTI"}

    def test_a_prefix_is_put_in_front(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("LD_LIBRARY_PATH", "/before")
        (tmp_path / "lib").mkdir()
        (tmp_path / "share" / "ament_index").mkdir(parents=True)
        found = workspace_environment(str(tmp_path))
        assert found["LD_LIBRARY_PATH"] == f"{tmp_path}/lib:/before"
        assert found["AMENT_PREFIX_PATH"].split(":")[0] == str(tmp_path)
        assert "PATH" not in found

    def test_several_add_up_and_nothing_is_left_behind(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("RMW_A", "old")
        monkeypatch.delenv("RMW_B", raising=False)
        (tmp_path / "setup.sh").write_text('export RMW_B="$RMW_A"\n')
        found = workspace_environments(["RMW_A=new", str(tmp_path)])
        assert found == {"RMW_A": "new", "RMW_B": "new"}
        with applied_environment(found):
            assert os.environ["RMW_B"] == "new"
            assert inherited_environment(os.environ, ())["RMW_A"] == "new"
        assert os.environ["RMW_A"] == "old"
        assert "RMW_B" not in os.environ
        with applied_environment({"RMW_A": ""}):
            assert "RMW_A" not in os.environ
        assert os.environ["RMW_A"] == "old"
