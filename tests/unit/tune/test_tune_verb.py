"""What the verb does with a search: writes what is proved only, and says how to go on."""

from __future__ import annotations

import contextlib
import json
import os
import stat
from pathlib import Path
from typing import Any

import pytest

from r2bspec.cli.main import main
from r2bspec.errors import ExitStatus
from r2bspec.execute.errors import InterruptedRunError
from r2bspec.plan.tuning_space import Choice, Deployment, Setting
from r2bspec.tune.patch import OVERLAY_SUFFIX
from ros_runs import Bench, relay_spec
from tuning_results import improved

SHARED = Deployment(
    (
        Choice(
            lever="graph.placement",
            place=1,
            setting=Setting(text="shared", sets=("graph.placement=shared",)),
        ),
    )
)


@pytest.fixture
def spec(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("r2bspec.cli.tune.locked_host", lambda *_, **__: contextlib.nullcontext())
    slos = {"all": {"at": "20 Hz", "require": ["received > 0"]}}
    return Bench(tmp_path).write(relay_spec(slos=slos))


def found(monkeypatch: pytest.MonkeyPatch, outcome: str) -> None:
    """Every search ends with an outcome, or is interrupted."""

    def tune(*_: Any, **__: Any) -> Any:
        if outcome == "interrupted":
            raise InterruptedRunError("interrupted by SIGINT")
        return improved(outcome=outcome, winner=SHARED)

    monkeypatch.setattr("r2bspec.tune.run_search.tune", tune)


@pytest.mark.parametrize(
    ("outcome", "status", "changed"), [("improved", 0, True), ("not shown", 3, False)]
)
def test_only_what_is_proved_is_written(
    spec: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    outcome: str,
    status: int,
    *,
    changed: bool,
) -> None:
    found(monkeypatch, outcome)
    words = ["tune", str(spec), "--quiet", "--format", "json", "--output", str(spec.parent)]
    assert main(words) == status
    out, err = capsys.readouterr()
    assert json.loads(out)["outcome"] == outcome
    assert ("+  placement: shared" in err) is changed
    patch = spec.with_name("deployment.patch")
    assert patch.exists() is changed
    assert "placement: shared" not in spec.read_text()
    assert main([*words, "--write"]) == status
    assert ("placement: shared" in spec.read_text()) is changed


def test_an_overlay_is_a_new_file(
    spec: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A value that comes from a variable cannot be written into the spec."""
    found(monkeypatch, "improved")
    text = spec.read_text()
    assert "graph:\n" in text
    text = text.replace("graph:\n", "graph:\n  placement: $(var place)\n")
    spec.write_text(f"variables: {{place: separate}}\n{text}")
    words = ["tune", str(spec), "--quiet", "--output", str(spec.parent), "--write"]
    mask = os.umask(0o027)
    try:
        assert main(words) == 0, capsys.readouterr().err
    finally:
        os.umask(mask)
    overlay = spec.with_name(
        f"{spec.name.removesuffix('.yaml').removesuffix('.r2b')}{OVERLAY_SUFFIX}"
    )
    assert "placement: shared" in overlay.read_text()
    assert stat.S_IMODE(overlay.stat().st_mode) == 0o640
    # Once more it is a file that exists, whose mode is kept.
    overlay.chmod(0o600)
    assert main(words) == 0
    assert stat.S_IMODE(overlay.stat().st_mode) == 0o600
    assert "place: separate" in spec.read_text()


def test_the_search_has_its_own_status_where_a_patch_cannot_be_made(
    spec: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def tune(*_: Any, **__: Any) -> Any:
        spec.unlink()
        return improved(outcome="improved", winner=SHARED)

    text = spec.read_text()
    monkeypatch.setattr("r2bspec.tune.run_search.tune", tune)
    words = ["tune", str(spec), "--quiet", "--output", str(spec.parent)]
    stale = spec.with_name("deployment.patch")
    stale.write_text("of an earlier search")
    assert main(words) == 0
    out, err = capsys.readouterr()
    assert "Proof" in out
    assert "no patch: " in err
    assert "help: " in err
    assert not stale.exists()
    # What is asked for has to be done.
    spec.write_text(text)
    assert main([*words, "--write"]) == ExitStatus.USAGE
    assert "Proof" in capsys.readouterr().out


def test_a_search_that_is_interrupted_says_how_it_goes_on(
    spec: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    found(monkeypatch, "interrupted")
    assert main(["tune", str(spec), "--output", "here"]) == ExitStatus.INTERRUPTED
    assert "--output here --resume" in capsys.readouterr().err


def test_hosts_are_those_of_a_fleet(spec: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["tune", str(spec), "--hosts", "a"]) == ExitStatus.USAGE
    assert "need --on" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("metric", "way_out"),
    [
        ("throughput.mean", "is better when it is larger"),
        ("relay.callback.p99", "is not observed"),
        ("cpu.nobody.mean", "there is no metric"),
    ],
)
def test_what_cannot_be_minimized_is_refused_before_anything_is_played(
    spec: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], metric: str, way_out: str
) -> None:
    folder = tmp_path / "search"
    words = ["tune", str(spec), "--quiet", "--output", str(folder), "--minimize", metric]
    assert main(words) == ExitStatus.USAGE
    shown = capsys.readouterr().err
    assert f"{metric} cannot be minimized" in shown
    assert way_out in shown
    assert "help:" in shown
    assert not folder.exists()
