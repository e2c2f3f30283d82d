"""Which profilers there are, how they are called, and what is seen before a run."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import pytest

from plans import process_plan
from r2bspec.errors import UsageError
from r2bspec.execute.errors import ProfilerError
from r2bspec.execute.profiled_iteration import profiled_processes, profiled_rate
from r2bspec.execute.profilers import Profiler, find_profiler, require_usable, stacks_of
from r2bspec.plan.plan import Plan, PlayPlan, ProcessPlan
from run_simulation import Played, Simulation

BASE = Path("/runs/one/profile/relay/relay")

SAMPLES = """\
relay
\t    7ffd2a5cd8f4 __vdso_clock_gettime ([vdso])
\t           5d61a clock_gettime@@GLIBC_2.17 (/usr/lib/x86_64-linux-gnu/libc.so.6)
\t            1a43 compute_ms (/tmp/a (b) c/relay)
\t            12e0 main (/tmp/a (b) c/relay)

dds.shm 7 x
\t          1bb1c0 eprosima::fastdds::dds::Reader<int (*)(char)>::read (/lib/libfastrtps.so.2.14)
\t               0 [unknown] (/lib/libfastrtps.so.2.14)
\tffffffff8a000000 [unknown] ([unknown])

idle

"""


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


def names(plan: Plan, node: str = "") -> list[str]:
    return [profiled_process.name for profiled_process in profiled_processes(plan, node)]


def test_every_process_of_the_graph_is_observed_unless_one_is_named() -> None:
    assert names(GRAPH) == ["shared", "relay"]
    assert names(GRAPH, "right") == ["shared"]
    assert names(GRAPH, "relay") == ["relay"]
    assert names(GRAPH, "monitor") == ["monitor"]


def test_nodes_in_the_process_of_the_harness_are_observed_there() -> None:
    assert names(plan_of(process_plan("harness", "harness", "relay"))) == ["harness"]


def test_an_unknown_node_is_refused_with_the_known_ones() -> None:
    with pytest.raises(UsageError, match="starts no node 'resize'") as caught:
        profiled_processes(GRAPH, "resize")
    assert caught.value.hint == "It starts left, monitor, player, relay, right, shared."


def test_a_graph_that_others_start_has_no_process_to_observe() -> None:
    with pytest.raises(UsageError, match="no process of the graph"):
        profiled_processes(plan_of(process_plan("player", "player")), "")


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


def test_perf_and_py_spy_attach_to_what_runs() -> None:
    perf = find_profiler("perf")
    assert perf.attaches
    argv = perf.attach_argv([7, 8], BASE)
    assert argv[1] == "record"
    assert argv[-4:] == ["-o", f"{BASE}.perf.data", "-p", "7,8"]
    spy = find_profiler("py-spy")
    assert spy.attaches
    argv = spy.attach_argv([7, 8], BASE)
    assert argv[argv.index("--output") + 1 :] == [f"{BASE}.folded", "--pid", "7"]


def test_nsys_and_other_commands_are_put_before_the_command_of_the_process() -> None:
    nsys = find_profiler("nsys")
    assert (nsys.name, nsys.attaches) == ("nsys", False)
    words = nsys.prefix(BASE)
    assert words[1] == "profile"
    assert words[-2:] == ("--output", str(BASE))
    own = find_profiler("/usr/bin/valgrind --tool=callgrind '--out=$(profile).a b'")
    assert own.name == "valgrind"
    assert own.prefix(BASE) == ("/usr/bin/valgrind", "--tool=callgrind", f"--out={BASE}.a b")
    # With words of its own, nsys is a command like others.
    assert find_profiler("nsys launch").prefix(BASE)[1:] == ("launch",)


@pytest.mark.parametrize("text", ["", "  ", "perf 'record"])
def test_words_that_are_no_command_are_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--profile"):
        find_profiler(text)


@pytest.mark.parametrize(
    ("name", "way_out"),
    [("perf", "linux-perf"), ("py-spy", "r2bspec[profile]"), ("nsys", "Nsight")],
)
def test_a_profiler_that_is_missing_is_named_with_the_way_to_install_it(
    name: str, way_out: str
) -> None:
    kind = name if name != "nsys" else "prefix"
    with pytest.raises(ProfilerError, match=f"{name}.* is not installed") as caught:
        require_usable(Profiler(name, (name,), kind))  # type: ignore[arg-type]
    assert way_out in caught.value.hint


def test_a_profiler_that_may_not_observe_is_quoted_with_the_way_to_permit_it(
    tmp_path: Path,
) -> None:
    refused = tmp_path / "py-spy"
    refused.write_text(
        "#!/bin/sh\necho 'Error: Permission Denied: Try running again' >&2\nexit 1\n"
    )
    refused.chmod(0o755)
    with pytest.raises(ProfilerError, match="Permission Denied") as caught:
        require_usable(Profiler("py-spy", (str(refused),), "py-spy"))
    assert "ptrace_scope" in caught.value.hint
    with pytest.raises(ProfilerError) as caught:
        require_usable(Profiler("perf", (str(refused),), "perf"))
    assert "perf_event_paranoid" in caught.value.hint


def test_the_stacks_of_perf_are_read_with_their_threads() -> None:
    assert list(stacks_of(SAMPLES.splitlines(keepends=True))) == [
        ("relay", "main", "compute_ms", "clock_gettime@@GLIBC_2.17", "__vdso_clock_gettime"),
        (
            "dds.shm 7 x",
            "[unknown]",
            "[libfastrtps.so.2.14]",
            "eprosima::fastdds::dds::Reader<int (*)(char)>::read",
        ),
    ]


def test_the_last_sample_needs_no_empty_line() -> None:
    assert list(stacks_of(["relay", "\t 1 main (/a)"])) == [("relay", "main")]
