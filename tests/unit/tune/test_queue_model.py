"""The model of a deployed graph, against the closed forms of queueing theory."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from r2bspec.tune.queue_model import (
    Callback,
    ExecutorModel,
    GraphModel,
    Reaction,
    Simulated,
    block_places,
    simulate,
)

STEPS = 2000


def reaction(node: str, topic: str, work_s: np.ndarray, output: str, **fields: object) -> Reaction:
    callbacks = tuple(Callback(float(each), ((output, float(each)),)) for each in work_s)
    return Reaction(node, topic, (callbacks,), **{"depth": 10**6, **fields})  # type: ignore[arg-type]


def graph(*executors: ExecutorModel, cores: int = 8, monitor: str = "/out") -> GraphModel:
    ends = {(each.topic, each.node) for one in executors for each in one.reactions}
    at_once = (np.zeros(1),)
    return GraphModel(
        executors=executors,
        inputs=("/in",),
        monitors={"out": monitor},
        transports=dict.fromkeys(ends | {(monitor, "out")}, at_once),
        cores=cores,
    )


def played(model: GraphModel, due_s: np.ndarray, seed: int = 1) -> Simulated:
    random = np.random.default_rng(seed)
    places = [(0, (k + 0.5) / due_s.size) for k in range(due_s.size)]
    return simulate(model, due_s, places, random)


def poisson(rate_hz: float, seed: int, steps: int = STEPS) -> np.ndarray:
    return np.cumsum(np.random.default_rng(seed).exponential(1 / rate_hz, steps))


def mean_and_error(models: list[tuple[GraphModel, np.ndarray]]) -> tuple[float, float]:
    means = [float(np.nanmean(played(*each).latency_s["out"])) for each in models]
    return float(np.mean(means)), float(np.std(means, ddof=1) / math.sqrt(len(means)))


@pytest.mark.parametrize("load", [0.5, 0.8])
def test_poisson_arrivals_at_one_server_wait_as_in_m_d_1(load: float) -> None:
    service_s = 0.01
    model = graph(ExecutorModel("p", (reaction("n", "/in", np.full(1, service_s), "/out"),)))
    found, error = mean_and_error([(model, poisson(load / service_s, seed)) for seed in range(8)])
    expected = service_s * (1 + load / (2 * (1 - load)))
    assert abs(found - expected) < 4 * error
    assert error < 0.1 * expected


def test_a_tandem_of_exponential_servers_takes_as_long_as_its_parts() -> None:
    # Burke: what leaves an M/M/1 queue is again a Poisson process, so times simply add up.
    rate_hz, means_s = 60.0, (0.008, 0.01, 0.004)
    models = []
    for seed in range(10):
        random = np.random.default_rng(50 + seed)
        topics = ("/in", "/a", "/b", "/out")
        executors = [
            ExecutorModel(
                f"p{k}",
                (reaction(f"n{k}", topics[k], random.exponential(mean, STEPS), topics[k + 1]),),
            )
            for k, mean in enumerate(means_s)
        ]
        models.append((graph(*executors), poisson(rate_hz, seed)))
    found, error = mean_and_error(models)
    expected = sum(1 / (1 / mean - rate_hz) for mean in means_s)
    assert abs(found - expected) < 4 * error
    assert error < 0.1 * expected


def test_nodes_that_share_processors_wait_as_in_m_m_c() -> None:
    # All k that work proceed at the speed min(1, c / k), so one of them ends as often as in M/M/c,
    # and as many are there in the mean (Erlang's C). The nodes take turns, and hardly ever wait for
    # their own last callback.
    cores, service_s, load, nodes = 3, 0.01, 0.7, 40
    topics = [f"/turn{place}" for place in range(nodes)]
    turns = tuple(Callback(0.0, ((topics[step % nodes], 0.0),)) for step in range(STEPS))
    router = ExecutorModel("router", (Reaction("router", "/in", (turns,), depth=10**6),))
    models = []
    for seed in range(8):
        work_s = np.random.default_rng(70 + seed).exponential(service_s, STEPS)
        workers = [
            ExecutorModel(topic, (reaction(topic[1:], topic, work_s, "/out"),)) for topic in topics
        ]
        arrivals = poisson(load * cores / service_s, seed)
        models.append((graph(router, *workers, cores=cores), arrivals))
    found, error = mean_and_error(models)
    offered = load * cores
    queued = offered**cores / math.factorial(cores) / (1 - load)
    waits = queued / (queued + sum(offered**k / math.factorial(k) for k in range(cores)))
    expected = service_s * (1 + waits / (cores * (1 - load)))
    assert abs(found - expected) < 4 * error
    assert error < 0.1 * expected


@pytest.mark.parametrize("limit", ["threads", "cores", "lock"])
def test_servers_that_share_have_the_capacity_of_all(limit: str) -> None:
    """Ten nodes that all take each step, with 1 ms of work each: 10 ms of work on 2 servers."""
    nodes = [
        reaction(f"n{k}", "/in", np.full(1, 0.001), "/out" if k == 9 else f"/o{k}")
        for k in range(10)
    ]
    if limit == "cores":
        executors = [ExecutorModel(f"p{k}", (node,)) for k, node in enumerate(nodes)]
        model, servers = graph(*executors, cores=2), 2
    else:
        threads = 2 if limit == "threads" else 8
        executor = ExecutorModel("p", tuple(nodes), threads=threads, is_python=limit == "lock")
        model, servers = graph(executor), 2 if limit == "threads" else 1
    periods = np.arange(400) * 0.02
    alone = played(model, periods)
    assert np.nanmax(alone.latency_s["out"]) == pytest.approx(0.01 / servers, rel=1e-6)
    # Offered more than the servers can do, each step is later than the one before by what lacks.
    every_s = 0.01 / servers * 0.9
    late = played(model, np.arange(400) * every_s).latency_s["out"]
    assert np.polyfit(np.arange(400), late, 1)[0] == pytest.approx(0.01 / servers * 0.1, rel=0.05)


def test_a_queue_keeps_the_last_messages() -> None:
    slow = reaction("n", "/in", np.full(1, 0.1), "/out", depth=2)
    found = played(graph(ExecutorModel("p", (slow,))), np.arange(20) * 0.0101)
    came = np.flatnonzero(~np.isnan(found.latency_s["out"]))
    # The first is taken at once. After it, 8 and 9 are left; while 8 is done, 18 and 19.
    assert came.tolist() == [0, 8, 18, 19]
    assert found.overwritten == 16


def test_one_thread_looks_again_only_when_all_that_was_ready_is_done() -> None:
    # While `first` works on step 1, `second` gets step 0: both are ready, and each is called once.
    first = reaction("first", "/in", np.full(1, 0.01), "/mid")
    second = reaction("second", "/mid", np.full(1, 0.01), "/out")
    model = graph(ExecutorModel("p", (first, second)))
    found = played(model, np.zeros(3))
    assert found.latency_s["out"].tolist() == pytest.approx([0.03, 0.05, 0.06])


def test_a_node_that_fuses_waits_for_the_last_of_its_inputs() -> None:
    fuse = [
        Reaction(
            "fuse", topic, ((Callback(0.001, (("/out", 0.001),)),),), joins=frozenset({"/a", "/b"}),
            alone=((Callback(0.0005),),),
        )
        for topic in ("/a", "/b")
    ]  # fmt: skip
    left = reaction("left", "/in", np.full(1, 0.004), "/a")
    right = reaction("right", "/in", np.full(1, 0.009), "/b")
    model = graph(
        ExecutorModel("l", (left,)), ExecutorModel("r", (right,)), ExecutorModel("f", tuple(fuse))
    )
    found = played(model, np.arange(50) * 0.05)
    assert found.latency_s["out"] == pytest.approx(np.full(50, 0.010))


def test_a_timer_publishes_the_newest_message() -> None:
    keep = Reaction("n", "/in", ((Callback(0.0),),))
    tick = Reaction("n", "", ((Callback(0.0, (("/out", 0.0),)),),), period_s=0.02)
    model = graph(ExecutorModel("p", (keep, tick)))
    found = played(model, np.arange(2000) * 0.0371)
    waits = found.latency_s["out"]
    assert not np.isnan(waits).any()
    assert 0 <= waits.min() < 0.002
    assert 0.018 < waits.max() <= 0.02


def test_what_waits_without_a_processor_is_not_slowed_down() -> None:
    sleeping = [
        ExecutorModel(f"p{k}", (reaction(f"n{k}", "/in", np.full(1, 0.01), f"/o{k}"),),
                      processor_share=0.0)
        for k in range(5)
    ]  # fmt: skip
    model = graph(*sleeping, cores=1, monitor="/o3")
    found = played(model, np.arange(10) * 0.1)
    assert found.latency_s["out"] == pytest.approx(np.full(10, 0.01))


def test_pinned_processes_share_their_processors_alone() -> None:
    executors = [
        ExecutorModel(f"p{k}", (reaction(f"n{k}", "/in", np.full(1, 0.01), f"/o{k}"),),
                      cpus=frozenset({0 if k < 2 else 1}))
        for k in range(3)
    ]  # fmt: skip
    for monitor, expected_s in (("/o0", 0.02), ("/o2", 0.01)):
        found = played(graph(*executors, cores=2, monitor=monitor), np.arange(5) * 0.1)
        assert found.latency_s["out"] == pytest.approx(np.full(5, expected_s))


def test_blocks_keep_together_what_followed_each_other() -> None:
    random = np.random.default_rng(4)
    places = block_places(1000, (100, 0, 40), random)
    assert len(places) == 1000
    assert {segment for segment, _ in places} == {0, 2}
    steps = [round(place * (100, 0, 40)[segment] - 0.5) for segment, place in places]
    followed = sum(after == before + 1 for before, after in itertools.pairwise(steps))
    assert followed > 900


def test_nodes_that_lead_to_each_other_without_end_do_not_last_for_ever() -> None:
    there = reaction("there", "/in", np.zeros(1), "/back")
    back = reaction("back", "/back", np.zeros(1), "/in")
    found = played(graph(ExecutorModel("p", (there, back))), np.arange(3) * 0.1)
    assert np.isnan(found.latency_s["out"]).all()
