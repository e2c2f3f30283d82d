"""Profilers observe one more iteration, and nothing that counts."""

from __future__ import annotations

import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import pytest

from nightly import only_nightly

pytest.importorskip("rclpy")

from c_nodes import c_node_spec
from r2bspec.execute.errors import CertainRunError
from r2bspec.execute.measurement.extra_iteration import find_profiler, require_usable
from r2bspec.record.run_record import ProfileRecord
from ros_runs import Bench, Finished, relay_node, relay_spec
from ros_runs import bench as bench

STEPS = 20
"""Of the one iteration of `relay_spec`, and of the one that is observed."""

WARM_UP = 10

NSYS = """#!/bin/sh
# In place of the program of NVIDIA: takes the same words, and writes its file at the end.
while [ "$1" != --output ]; do echo "$1" >> {calls}; shift; done
output=$2
shift 2
echo "$@" >> {calls}
trap : INT
"$@" &
while kill -0 $! 2> /dev/null; do wait; done
echo report > "$output.nsys-rep"
: > "$output$(printf '\\377')"
"""


def require(name: str) -> None:
    try:
        require_usable(find_profiler(name))
    except CertainRunError as error:
        pytest.skip(f"{error}; {error.hint}")


def graph(node: dict[str, Any]) -> dict[str, Any]:
    return relay_spec(graph={"nodes": {"node": node}})


def the_profile(done: Finished) -> ProfileRecord:
    (found,) = done.run().record.profiles
    return found


def assert_measured_before(done: Finished) -> None:
    """See that the run is complete, and that all of it was over before the profiler started."""
    done.assert_complete()
    run = done.run()
    (iteration,) = done.segments()
    assert run.monitor(iteration, "out").size == STEPS
    profile = the_profile(done)
    counting = [
        segment
        for segment in run.record.segments
        if segment.kind != "anatomy" and (segment.kind != "warm_up" or segment.start == 1)
    ]
    assert max(each.ended_ns for each in counting) <= profile.began_ns < profile.ended_ns
    (phase_ns,) = [at for at, text in run.record.events if text == "phase profile"]
    assert max(each.ended_ns for each in counting) <= phase_ns


def test_py_spy_shows_the_functions_of_a_python_node(bench: Bench) -> None:
    require("py-spy")
    done = bench.run(graph(relay_node(10.0)), "--profile", "py-spy")
    assert_measured_before(done)
    assert the_profile(done).error == ""
    assert "_on_message" in (done.folder / "profile/node/node.svg").read_text()
    assert "Profile of node at 20 Hz, with py-spy: profile/node/node.svg" in done.stdout
    assert len(done.run().record.starts) == 1
    # The profile is no segment, and no part of the judgement.
    assert {segment.kind for segment in done.run().record.segments} == {"warm_up", "iteration"}


@only_nightly()
def test_a_run_with_a_profiler_is_observed_from_inside_too(bench: Bench) -> None:
    done = bench.run(graph(relay_node(10.0)), "--anatomy", "--profile", "env SEEN=1")
    assert_measured_before(done)
    (seen,) = done.segments("anatomy")
    (record,) = done.run().record.anatomies
    assert (record.start, record.error) == (seen.start, "")
    assert done.run().has_anatomy(seen)


@only_nightly()
@pytest.mark.parametrize("placement", ["separate", "graph"])
def test_perf_shows_the_functions_of_a_program_in_c(bench: Bench, placement: str) -> None:
    require("perf")
    node = c_node_spec("relay", parameters={"service_time_ms": 10.0})
    spec = graph(node) | {"harness": {"placement": placement}}
    done = bench.run(spec, "--profile", "perf")
    assert_measured_before(done)
    assert the_profile(done).error == ""
    data = done.folder / "profile/node/node.perf.data"
    script = subprocess.run(
        ["perf", "script", "--no-inline", "-F", "comm,ip,sym", "-i", str(data)],  # noqa: S607
        capture_output=True,
        text=True,
        check=True,
    )
    assert "compute_ms" in script.stdout


@only_nightly()
def test_nsys_starts_the_nodes_anew(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = tmp_path / "calls"
    program = tmp_path / "nsys"
    program.write_text(NSYS.format(calls=calls))
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    node = c_node_spec("relay")
    done = bench.run(graph(node), "--profile", "nsys")
    assert_measured_before(done)
    assert the_profile(done).files == (
        "profile/node/node.nsys-rep",
        "profile/node/node\N{REPLACEMENT CHARACTER}",
    )
    first, *options, called = calls.read_text().splitlines()
    assert first == "profile"
    assert "--trace=cuda,nvtx,osrt" in options
    assert called.startswith(node["command"][0])
    # A start of its own, which is none of those that are measured.
    assert len(done.run().record.starts) == 1
    ended = [process for process in done.run().record.processes if process.name == "node"]
    assert [each.exit_code for each in ended] == [0, 0]


@only_nightly()
def test_a_program_that_writes_no_file_costs_no_verdict(bench: Bench) -> None:
    done = bench.run(graph(c_node_spec("relay")), "--profile", "env")
    assert_measured_before(done)
    assert the_profile(done).error == "env wrote no file in the run folder"
    assert "Profile of node at 20 Hz, with env, is missing" in done.stdout


@only_nightly()
def test_a_node_that_crashes_with_the_profiler_costs_no_verdict(bench: Bench) -> None:
    require("perf")
    node = c_node_spec("crash", parameters={"messages": WARM_UP + STEPS + 2})
    done = bench.run(graph(node), "--profile", "perf")
    assert_measured_before(done)
    assert "process node was killed by SIGSEGV" in the_profile(done).error
    assert done.run().record.reason == ""


@only_nightly()
def test_an_interruption_ends_the_profiler_too(bench: Bench) -> None:
    require("py-spy")
    spec = graph(relay_node(1.0))
    spec["benchmark"]["duration"] = "4 s"
    with bench.start(spec, "--profile", "py-spy") as running:
        running.wait_for("20 Hz, with py-spy")
        running.process.send_signal(signal.SIGINT)
        done = running.finish()
    assert done.status == 130
    assert done.run().record.status == "incomplete"
    (iteration,) = done.segments()
    assert iteration.complete


def test_what_cannot_be_observed_is_said_before_anything_is_started(bench: Bench) -> None:
    done = bench.run(graph(relay_node()), "--profile", "no-such-profiler")
    assert done.status == 2
    assert done.error.startswith("error[R2B652")
    assert "'no-such-profiler' is not installed" in done.error
    assert done.run().record.processes == ()
