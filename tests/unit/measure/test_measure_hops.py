"""The way to a monitor: which hops there are, and how long each took."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np
import pytest

from r2bspec.judge.measure.matching import StepRatio, match
from r2bspec.judge.measure.run_samples import hop_samples
from r2bspec.judge.measure.samples import HopSamples, pool_hops
from r2bspec.language.spec import QoS
from r2bspec.plan.plan import InputPlan, MonitorPlan, Plan, TapPlan, TopicPlan
from r2bspec.plan.taps import PLAYER, all_taps, hops_to, tap_monitors
from r2bspec.record.sample_arrays import MONITOR_DTYPE, Rows
from run_simulation import Played, Simulation, playback_rows

STEPS = 5
PLAYBACK = playback_rows(Played(10, np.zeros(STEPS)))


def plan(edges: dict[str, tuple[str, ...]], monitor: str = "/out", *inputs: str) -> Plan:
    """A plan in which each node reads the topics that it is mapped to and writes one of its name.

    The node ``/n/x`` writes ``/x``; all topics but the inputs and the monitored one are tapped.
    """
    inputs = inputs or ("/in",)
    names = sorted({*edges, *inputs, *(name for read in edges.values() for name in read)})
    topics = tuple(
        TopicPlan(
            name=name,
            type="T",
            phase="measure",
            writers=("player",) if name in inputs else (f"/n{name}",),
            readers=tuple(f"/n{to}" for to, read in edges.items() if name in read),
        )
        for name in names
    )
    taps = tuple(TapPlan(topic=name, type="T") for name in names if name not in {*inputs, monitor})
    return msgspec.structs.replace(
        Simulation().plan(),
        topics=topics,
        inputs=tuple(
            InputPlan(topic=name, type="T", source="", bag_topic="", qos=QoS()) for name in inputs
        ),
        monitors=(
            MonitorPlan(name="m", topic=monitor, type="T", match="stamp", qos=None, taps=taps),
        ),
    )


def rows(times_ms: Mapping[int, float]) -> Rows:
    """What arrived of some steps, so many milliseconds after each was published, in order."""
    found = np.zeros(len(times_ms), MONITOR_DTYPE)
    for row, (step, later_ms) in zip(found, times_ms.items(), strict=True):
        row["stamp_ns"] = PLAYBACK["stamp_ns"][step]
        row["received_ns"] = PLAYBACK["published_ns"][step] + round(later_ms * 1e6)
    return found[np.argsort(found["received_ns"], kind="stable")]


def hops(of: Plan, taps: dict[str, Rows], seen: Rows) -> dict[tuple[str, str], HopSamples]:
    (monitor,) = of.monitors
    found = hop_samples(of, monitor, PLAYBACK, taps, seen, match(PLAYBACK, seen, "stamp"))
    return {(each.source, each.target): each for each in found}


CHAIN = plan({"/a": ("/in",), "/b": ("/a",), "/out": ("/b",)})


def test_a_chain_has_a_hop_from_each_topic_to_the_next() -> None:
    assert hops_to(CHAIN, CHAIN.monitors[0]) == ((PLAYER, "/a"), ("/a", "/b"), ("/b", "/out"))


def test_a_graph_that_joins_has_a_hop_for_each_branch() -> None:
    stereo = plan(
        {"/l": ("/left",), "/r": ("/right",), "/out": ("/l", "/r")}, "/out", "/left", "/right"
    )
    assert hops_to(stereo, stereo.monitors[0]) == (
        (PLAYER, "/l"),
        (PLAYER, "/r"),
        ("/l", "/out"),
        ("/r", "/out"),
    )


def test_a_way_round_and_a_loop_end() -> None:
    looped = plan({"/a": ("/in", "/b"), "/b": ("/a",), "/out": ("/b", "/in")})
    assert hops_to(looped, looped.monitors[0]) == (
        (PLAYER, "/a"),
        ("/b", "/a"),
        (PLAYER, "/out"),
        ("/b", "/out"),
        ("/a", "/b"),
    )


def test_each_tap_is_watched_once_under_a_name_that_no_monitor_has() -> None:
    twice = (*CHAIN.monitors, msgspec.structs.replace(CHAIN.monitors[0], name="again"))
    assert [tap.topic for tap in all_taps(twice)] == ["/a", "/b"]
    assert [(tap_monitor.name, tap_monitor.qos) for tap_monitor in tap_monitors(twice)] == [
        ("tap.a", None),
        ("tap.b", None),
    ]


def test_hops_of_the_same_messages_add_up() -> None:
    every = range(STEPS)
    found = hops(
        CHAIN,
        {"/a": rows({n: 1 + n for n in every}), "/b": rows({n: 5 + n for n in every})},
        rows(dict.fromkeys(every, 20)),
    )
    assert found[PLAYER, "/a"].times == pytest.approx([0.001, 0.002, 0.003, 0.004, 0.005])
    assert found["/a", "/b"].times == pytest.approx(np.full(STEPS, 0.004))
    assert sum(hop.times for hop in found.values()) == pytest.approx(np.full(STEPS, 0.020))


def test_a_loss_is_counted_at_the_hop_where_it_happened() -> None:
    found = hops(
        CHAIN,
        {"/a": rows(dict.fromkeys((0, 1, 3, 4), 1)), "/b": rows(dict.fromkeys((0, 3, 4), 2))},
        rows(dict.fromkeys((0, 3, 4), 3)),
    )
    counts = [(hop.times.size, hop.missed) for hop in found.values()]
    assert counts == [(4, 1), (3, 1), (3, 0)]


def test_the_first_of_several_messages_of_one_stamp_counts() -> None:
    twice = np.concatenate((rows({0: 1, 1: 1}), rows({0: 50, 1: 50})))
    seen = np.concatenate((rows({0: 3, 1: 3}), rows({0: 90})))
    found = hops(CHAIN, {"/a": twice, "/b": rows({0: 2, 1: 2})}, seen)
    assert found["/a", "/b"].times == pytest.approx([0.001, 0.001])
    assert found["/b", "/out"].times == pytest.approx([0.001, 0.001])


def test_a_tap_whose_messages_have_no_header_is_left_out() -> None:
    bare = rows(dict.fromkeys(range(STEPS), 2))
    bare["stamp_ns"] = 0
    every = dict.fromkeys(range(STEPS), 1)
    found = hops(CHAIN, {"/a": rows(every), "/b": bare}, rows(dict.fromkeys(range(STEPS), 4)))
    assert [*found] == [(PLAYER, "/a"), ("/a", "/out")]
    assert found["/a", "/out"].times == pytest.approx(np.full(STEPS, 0.003))


def test_a_silent_tap_has_missed_everything() -> None:
    none = rows({})
    found = hops(CHAIN, {"/a": none, "/b": none}, none)
    assert [hop.missed for hop in found.values()] == [STEPS, 0, 0]


def test_with_a_ratio_only_steps_that_complete_a_group_lead_to_an_answer() -> None:
    (monitor,) = CHAIN.monitors
    every = dict.fromkeys(range(STEPS), 1)
    seen = rows({1: 5, 3: 5})
    matched = match(PLAYBACK, seen, "order", StepRatio(inputs=2))
    found = hop_samples(
        CHAIN, monitor, PLAYBACK, {"/a": rows(every), "/b": rows(every)}, seen, matched
    )
    assert found[-1].times == pytest.approx([0.004, 0.004])
    assert found[-1].missed == 0


def test_iterations_are_pooled_hop_by_hop() -> None:
    one = HopSamples("/a", "/b", np.array([0.1]), 2)
    two = HopSamples("/a", "/b", np.array([0.2, 0.3]), 1)
    (pooled,) = pool_hops([(one,), (two,)])
    assert (pooled.source, pooled.target, pooled.missed) == ("/a", "/b", 3)
    assert pooled.times.tolist() == [0.1, 0.2, 0.3]
