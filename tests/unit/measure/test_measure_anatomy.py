"""Where each message spent its time: the parts of a path add up, whatever the graph does."""

from __future__ import annotations

import itertools
from dataclasses import replace

import msgspec
import numpy as np
import pytest

from nightly import size
from r2bspec.judge.measure.anatomy import Anatomy, anatomy
from r2bspec.judge.measure.anatomy_blockers import find_blockers
from r2bspec.judge.measure.anatomy_paths import NOT_SEEN, Path
from r2bspec.record.run_record import AnatomyKind
from simulated_anatomies import CHAIN, CLOCK_NS, FORK, TIMER, Observed, Stage, observed

LOOP = replace(
    CHAIN,
    stages=(
        Stage("track", ("/in", "/state"), "/pose", 0.001, keeps_stamp=False, period_s=0.02),
        Stage("map", ("/pose",), "/state", 0.001, keeps_stamp=False),
        Stage("show", ("/pose",), "/out", 0.001),
    ),
)

THREADS = replace(
    CHAIN,
    stages=tuple(replace(stage, process="all", executor="pool") for stage in CHAIN.stages),
    threads=(("pool", 3),),
)

BUSY = replace(FORK.with_stage("left", service_s=0.011, depth=1), burst=0.5)

OWN_THREAD = CHAIN.with_stage("blur", own_thread=True)

SEVERAL = CHAIN.with_stage("decode", publishes=3).with_stage("blur", depth=1)

GRAPHS = {
    "chain": CHAIN,
    "fork": FORK,
    "timer": TIMER,
    "loop": LOOP,
    "threads": THREADS,
    "busy": BUSY,
    "own thread": OWN_THREAD,
    "several": SEVERAL,
}


def joined(found: Observed) -> Anatomy:
    return anatomy(found.record, found.rows, found.plan, found.window_ns)


def total(path: Path) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return sum((np.nan_to_num(part.seconds) for part in path.parts), np.zeros(path.began_ns.size))


@pytest.mark.parametrize("name", GRAPHS)
def test_the_parts_of_every_message_add_up_to_its_latency(name: str) -> None:
    found = joined(observed(GRAPHS[name]))
    assert found.paths["out"]
    for path in found.paths["out"]:
        assert path.began_ns.size > 50
        np.testing.assert_allclose(total(path), path.seconds, rtol=0, atol=1e-12)
        assert not any(part.name == NOT_SEEN for part in path.parts)
        assert all(part.seconds.min() >= 0 for part in path.parts)


@pytest.mark.parametrize("name", ["chain", "fork", "threads", "busy", "own thread"])
def test_each_message_has_its_true_latency(name: str) -> None:
    simulated = observed(GRAPHS[name])
    for path in joined(simulated).paths["out"]:
        true_ns = sorted(simulated.latency_ns.values())
        assert sorted(path.ended_ns - path.began_ns)[-50:] == pytest.approx(
            true_ns[-50:], abs=50_000
        )


def test_a_message_that_came_first_waits_in_the_node_that_fuses() -> None:
    paths = joined(observed(FORK)).paths["out"]
    last = np.array([path.last for path in paths])
    assert (last.sum(axis=0) == 1).all()
    held = [part for path in paths for part in path.parts if part.name == "held"]
    assert {part.owner for part in held} == {"fuse"}
    right = next(path for path in paths if "/b" in path.hops)
    (waits,) = (part.seconds for part in right.parts if part.name == "held")
    assert waits[right.last].max(initial=0) == 0
    assert waits[~right.last].max() > 0


def test_of_a_pace_of_its_own_what_arrives_after_the_inputs_does_not_count() -> None:
    seen = observed(TIMER)
    began_ns, ended_ns = seen.window_ns
    seen = replace(seen, window_ns=(began_ns, (began_ns + ended_ns) // 2))
    (monitor,) = seen.plan.monitors
    paced = msgspec.structs.replace(monitor, match="own_pace")
    plan = msgspec.structs.replace(seen.plan, monitors=(paced,))
    (everything,) = joined(seen).paths["out"]
    found = joined(replace(seen, plan=plan))
    (path,) = found.paths["out"]
    assert path.ended_ns.max() <= seen.window_ns[1] < everything.ended_ns.max()
    assert found.monitored["out"] == path.seconds.size == found.series["out.path"].size


def test_a_timer_publishes_what_came_before_it() -> None:
    (path,) = joined(observed(TIMER)).paths["out"]
    assert path.by_timer.all()
    assert path.hops == ("player", "/in", "decode", "/image", "track", "/out")
    (held,) = (part.seconds for part in path.parts if part.name == "held")
    assert 0.0 < held.max() < 0.02


def test_the_messages_that_a_queue_dropped_are_counted() -> None:
    simulated = observed(BUSY)
    node = joined(simulated).nodes["left"]
    assert simulated.overtaken["left"] > 10
    # What was dropped after the last message that was taken may be still on its way.
    assert node.overtaken["/image"] == pytest.approx(simulated.overtaken["left"], abs=1)
    assert node.taken["/image"] + simulated.overtaken["left"] == pytest.approx(200, abs=1)


def test_the_load_of_a_node_is_the_share_of_the_time_in_its_callbacks() -> None:
    found = joined(observed(CHAIN))
    assert found.nodes["blur"].load == pytest.approx(0.4, rel=0.1)
    assert np.mean(found.series["blur.load"]) == pytest.approx(0.4, rel=0.1)
    assert np.median(found.series["blur.callback"]) == pytest.approx(0.004, rel=0.1)


def test_a_clock_that_steps_leaves_times_unseen_and_no_sum_wrong() -> None:
    simulated = observed(CHAIN)
    rows = simulated.rows.copy()
    hour_ns, middle_ns = 3_600_000_000_000, np.median(rows["began_ns"])
    for name in ("source_ns", "received_ns"):
        rows[name][rows[name] > CLOCK_NS + middle_ns] += hour_ns
    rows["clock_ns"][rows["began_ns"] > middle_ns] += hour_ns
    # Between the arrival of this message and its take, the clock stepped.
    crossing = np.flatnonzero((rows["kind"] == AnatomyKind.TAKE) & (rows["began_ns"] > middle_ns))
    rows["received_ns"][crossing[:3]] -= hour_ns
    (path,) = anatomy(simulated.record, rows, simulated.plan, simulated.window_ns).paths["out"]
    np.testing.assert_allclose(total(path), path.seconds, rtol=0, atol=1e-12)
    unseen = [part for part in path.parts if part.name == NOT_SEEN]
    assert 1 <= sum(np.count_nonzero(part.seconds) for part in unseen) <= 3
    assert path.began_ns.size == 200
    assert path.seconds.max() < 0.1


def test_a_middleware_without_times_of_reception_leaves_the_transport_unseen() -> None:
    simulated = observed(CHAIN)
    rows = simulated.rows.copy()
    rows["received_ns"] = 0
    (path,) = anatomy(simulated.record, rows, simulated.plan, simulated.window_ns).paths["out"]
    np.testing.assert_allclose(total(path), path.seconds, rtol=0, atol=1e-12)
    unseen = [part.owner for part in path.parts if part.name == NOT_SEEN]
    assert unseen == ["/in", "/image", "/blurred", "/out"]


@pytest.mark.parametrize("seed", range(size(8, 30)))
def test_forged_rows_raise_nothing_and_add_up(seed: int) -> None:
    random = np.random.default_rng(seed)
    simulated = observed(replace(FORK, steps=30))
    rows = simulated.rows.copy()
    for name in rows.dtype.names or ():
        struck = random.random(rows.size) < 0.1
        if name.endswith("_ns"):
            forged = random.choice([0, 1, -1, 2**62, -(2**62), CLOCK_NS], int(struck.sum()))
        else:
            forged = random.integers(0, 20, int(struck.sum()))
        rows[name][struck] = forged
    rows = rows[random.random(rows.size) < 0.9]
    random.shuffle(rows)
    found = anatomy(simulated.record, rows, simulated.plan, simulated.window_ns)
    for path in found.paths["out"]:
        np.testing.assert_allclose(total(path), path.seconds, rtol=1e-9, atol=1e-12)
    waiting = itertools.product(found.events.names.nodes, found.events.names.topics)
    for blocker in find_blockers(found.events, simulated.record, simulated.plan, waiting):
        assert blocker.n > 0
        assert blocker.mean > 0


def test_no_rows_are_no_paths() -> None:
    simulated = observed(CHAIN)
    found = anatomy(simulated.record, simulated.rows[:0], simulated.plan, simulated.window_ns)
    assert found.paths == {"out": ()}
    assert found.series == {}
    bare = msgspec.structs.replace(simulated.record, processes=(), objects=())
    found = anatomy(bare, simulated.rows, simulated.plan, simulated.window_ns)
    assert found.left_out == simulated.rows.size
