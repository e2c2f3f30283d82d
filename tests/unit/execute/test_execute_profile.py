"""Which profilers there are, how they are called, and what is seen before a run."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from plans import process_plan
from r2bspec.execute.errors import CertainRunError
from r2bspec.execute.measurement.extra_iteration import (
    Profiler,
    find_profiler,
    profiled_processes,
    profiled_rate,
    require_usable,
)
from r2bspec.extras import install_command
from r2bspec.plan.plan import Plan, PlayPlan, ProcessPlan
from run_simulation import Played, Simulation

BASE = Path("/runs/one/profile/relay/relay")


def plan_of(*processes: ProcessPlan, **changes: object) -> Plan:
    plan = Simulation(segments=[Played(30, np.full(90, 0.02))]).plan()
    return msgspec.structs.replace(plan, processes=processes, **changes)


GRAPH = plan_of(
    process_plan("loader", "loader", phase="load"),
    process_plan("preprocess.resize", "host", "resize", phase="preprocess"),
    process_plan("player", "player"),
    process_plan("monitor", "monitor"),
    process_plan("shared", "host", "left", "right"),
    process_plan("relay", "command", "relay"),
)


def test_every_process_of_the_graph_is_observed() -> None:
    assert [each.name for each in profiled_processes(GRAPH)] == ["shared", "relay"]
    # Nodes in the process of the harness are observed there.
    (process,) = profiled_processes(plan_of(process_plan("harness", "harness", "relay")))
    assert process.name == "harness"


def test_the_highest_rate_is_played_for_the_length_of_its_iterations() -> None:
    slow = PlayPlan(rate_hz=10.0, duration_ns=7, iterations=3)
    fast = PlayPlan(rate_hz=60.0, duration_ns=5, iterations=3)
    at_peak = PlayPlan(rate_hz=0.0, duration_ns=9, iterations=3)
    plan = plan_of(play=(slow, fast), play_at_peak=at_peak)
    assert profiled_rate(plan, None) == (60.0, 5)
    assert profiled_rate(plan, 90.0) == (90.0, 9)
    assert profiled_rate(plan, 30.0) == (60.0, 5)
    assert profiled_rate(plan_of(play=(), sustained_hz=(20.0, 40.0)), None)[0] == 40.0
    assert profiled_rate(plan_of(play=(), sustained_hz=()), 33.0)[0] == 33.0


def test_the_words_of_a_profiler_are_put_before_the_command_of_the_process() -> None:
    for name, end in (
        ("perf", ("-o", f"{BASE}.perf.data", "--")),
        ("py-spy", ("--output", f"{BASE}.svg", "--")),
        ("nsys", ("--output", str(BASE))),
    ):
        profiler = find_profiler(name)
        assert profiler.name == name
        assert profiler.prefix(BASE)[-len(end) :] == end
    own = find_profiler("/usr/bin/valgrind --tool=callgrind '--out=$(profile).a b'")
    assert own.name == "valgrind"
    assert own.prefix(BASE) == ("/usr/bin/valgrind", "--tool=callgrind", f"--out={BASE}.a b")
    # With words of its own, nsys is a command like others.
    assert find_profiler("nsys launch").prefix(BASE)[1:] == ("launch",)


@pytest.mark.parametrize(
    ("name", "way_out"),
    [("perf", "linux-perf"), ("py-spy", install_command("profile")), ("nsys", "Nsight")],
)
def test_a_profiler_that_is_missing_is_named_with_the_way_to_install_it(
    name: str, way_out: str
) -> None:
    with pytest.raises(CertainRunError, match=f"{name}.* is not installed") as caught:
        require_usable(Profiler(name, (name,)))
    assert way_out in caught.value.hint


@pytest.mark.parametrize(("name", "way_out"), [("py-spy", "PTRACE"), ("perf", "perf_event")])
def test_a_profiler_that_may_not_observe_is_quoted_with_the_way_to_permit_it(
    tmp_path: Path, name: str, way_out: str
) -> None:
    refused = tmp_path / name
    refused.write_text("#!/bin/sh\necho 'Error: Permission Denied' >&2\nexit 1\n")
    refused.chmod(0o755)
    with pytest.raises(CertainRunError, match="Permission Denied") as caught:
        require_usable(Profiler(name, (str(refused),)))
    assert way_out in caught.value.hint
