"""What the doctor says of the native harness."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.doctor import installation
from r2bspec.doctor.checkup import System
from r2bspec.native.build import BuildError


def test_without_a_compiler_there_is_a_problem_and_a_way_out(tmp_path: Path) -> None:
    pytest.importorskip("rclpy")
    (check,) = installation.check_native(System(environ={"PATH": str(tmp_path)}))
    assert check.status == "problem"
    assert "no C compiler" in check.found
    assert "apt install gcc" in check.advice


def test_what_was_built_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(installation, "harness_program", lambda _: Path("/cache/r2bspec_harness"))
    (check,) = installation.check_native(System(environ={}))
    assert (check.status, check.found) == ("ok", "/cache/r2bspec_harness")


def test_only_the_first_line_of_a_compiler_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(_: object) -> Path:
        raise BuildError("cc cannot compile x:\nerror 1\nerror 2", hint="install it")

    monkeypatch.setattr(installation, "harness_program", refuse)
    (check,) = installation.check_native(System(environ={}))
    assert (check.found, check.advice) == ("cc cannot compile x:", "install it")
