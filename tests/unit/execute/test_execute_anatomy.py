"""Where the processes of a run write what they do, and what is left of it."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from plans import process_plan
from r2bspec.execute import anatomy
from r2bspec.plan.plan import JoinPlan
from r2bspec.record.run_folder import RunFolder
from r2bspec.record.run_record import Segment
from run_simulation import Simulation


def test_a_later_start_removes_the_files_of_the_earlier_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(anatomy, "built", lambda _: tmp_path / "preload.so")
    plan = Simulation(segments=[]).plan()
    with anatomy.events_folder(plan, tmp_path) as folder:
        first = anatomy.AnatomyObservation(plan, 1, folder)
        (first.files / "node.1.rows").write_bytes(b"rows")
        second = anatomy.AnatomyObservation(plan, 2, folder)
        assert [each.name for each in folder.iterdir() if each.name.startswith("anatomy-")] == [
            second.files.name
        ]
    assert folder == tmp_path or not folder.exists()


def test_a_list_observes_these_nodes_and_the_harness() -> None:
    plan = msgspec.structs.replace(Simulation().plan(), anatomy=("blur",))
    blur, other = process_plan("p", "host", "blur"), process_plan("q", "command", "other")
    assert plan.observes(blur)
    assert plan.observes(process_plan("player", "player"))
    assert not plan.observes(other)
    assert plan.observes(msgspec.structs.replace(other, join=JoinPlan(player=True)))
    assert plan.observes(process_plan("blur", "container"))
    everything = msgspec.structs.replace(plan, anatomy=True)
    assert everything.observes(other)


def test_processes_that_were_not_observed_are_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(anatomy, "built", lambda _: tmp_path / "preload.so")
    processes = (process_plan("p", "host", "blur"), process_plan("q", "command", "other"))
    plan = msgspec.structs.replace(Simulation().plan(), processes=processes)
    segment = Segment(
        id="anatomy-001", kind="anatomy", rate_hz=10, index=1, steps=1, began_ns=0, ended_ns=1,
        complete=True,
    )  # fmt: skip

    def error(observed: bool | tuple[str, ...]) -> str:
        observing = msgspec.structs.replace(plan, anatomy=observed)
        observation = anatomy.AnatomyObservation(observing, 1, tmp_path)
        observation.store(segment, 1, RunFolder(tmp_path))
        return observation.record.error

    assert error(True).startswith("Without events of p, q: ")
    assert error(("blur",)).startswith("Without events of p: ")
