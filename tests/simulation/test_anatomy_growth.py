"""How often the part that was slowed in a simulated graph is the one that is named first."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from nightly import size
from r2bspec.judge.measure.anatomy import Anatomy, anatomy
from r2bspec.judge.measure.anatomy_growth import grown_parts
from simulated_anatomies import Graph, Stage, Style, observed

Figure = Callable[[str, object], None]

STYLES: tuple[Style, ...] = ("rclcpp", "rclpy", "rcl")


def random_graph(seed: int) -> Graph:
    """A chain of up to three nodes, a fork and a fusion, and one more node."""
    random = np.random.default_rng(seed)
    period_s = 0.01

    def stage(name: str, inputs: tuple[str, ...], output: str, process: str = "") -> Stage:
        return Stage(
            name,
            inputs,
            output,
            service_s=period_s * float(random.uniform(0.05, 0.6)),
            process=process,
            style=STYLES[random.integers(0, 3)],
            spread=float(random.uniform(0.02, 0.12)),
        )

    count = int(random.integers(1, 4))
    topics = ["/in", *(f"/t{number}" for number in range(count))]
    chain = [stage(f"s{number}", (topics[number],), topics[number + 1]) for number in range(count)]
    fork = [stage("left", (topics[-1],), "/a", "pair"), stage("right", (topics[-1],), "/b", "pair")]
    fork = [
        replace(each, service_s=min(each.service_s, 0.004), style=fork[0].style) for each in fork
    ]
    fuse = replace(stage("fuse", ("/a", "/b"), "/f"), fuses=True, service_s=0.001)
    names = [*topics, "/a", "/b", "/f", "/out"]
    return Graph(
        stages=(*chain, *fork, fuse, stage("show", ("/f",), "/out")),
        steps=400,
        transport_s=tuple((name, float(random.uniform(50e-6, 800e-6))) for name in names),
        threads=(("pair", 2),),
        burst=0.2,
        seed=seed,
    )


def slower(graph: Graph, random: np.random.Generator) -> tuple[Graph, set[str], str]:
    stage = graph.stages[random.integers(0, len(graph.stages))]
    change = graph.with_stage(stage.name, service_s=stage.service_s * 1.1)
    return change, {stage.name}, "callback"


def neighbour(graph: Graph, random: np.random.Generator) -> tuple[Graph, set[str], str]:
    stage = graph.stages[random.integers(0, len(graph.stages))]
    return graph.with_stage(stage.name, stretched=0.2), {stage.name}, "callback"


def larger(graph: Graph, random: np.random.Generator) -> tuple[Graph, set[str], str]:
    topic = graph.stages[random.integers(0, len(graph.stages))].output
    times = tuple((name, took * 1.1 if name == topic else took) for name, took in graph.transport_s)
    return replace(graph, transport_s=times), {topic}, "transport"


def shallow(graph: Graph, random: np.random.Generator) -> tuple[Graph, set[str], str]:
    del random
    (stage,) = (each for each in graph.stages if each.depth == 11)
    return graph.with_stage(stage.name, depth=1), {stage.name}, "queue"


def one_thread(graph: Graph, _: np.random.Generator) -> tuple[Graph, set[str], str]:
    return replace(graph, threads=()), {"left", "right"}, "wait"


Change = Callable[[Graph, np.random.Generator], tuple[Graph, set[str], str]]
CHANGES: tuple[Change, ...] = (slower, neighbour, larger, shallow, one_thread)


def joined(graph: Graph) -> Anatomy:
    found = observed(graph)
    return anatomy(found.record, found.rows, found.plan, found.window_ns)


def pair(seed: int) -> tuple[Anatomy, Anatomy, set[str], str]:
    random = np.random.default_rng(1000 + seed)
    graph = random_graph(seed)
    change = CHANGES[seed % len(CHANGES)]
    if change is shallow:
        # A queue matters where callbacks take as long as a period.
        name = graph.stages[int(random.integers(0, len(graph.stages) - 3))].name
        graph = graph.with_stage(name, service_s=0.009, spread=0.4, depth=11)
    changed, owners, part = change(graph, random)
    return joined(graph), joined(replace(changed, seed=seed + 10_000)), owners, part


@pytest.mark.timeout(1200)
def test_the_slowed_stage_and_its_part_are_named_first(record_property: Figure) -> None:
    wrong = []
    count = size(20, 200)
    for seed in range(count):
        base, change, owners, part = pair(seed)
        grown = grown_parts(base, change)
        if not grown or grown[0].owner not in owners or grown[0].name != part:
            wrong.append((seed, owners, part, [each.text for each in grown[:3]]))
    record_property("figure", f"named first: {count - len(wrong)} of {count}")
    assert len(wrong) <= 0.05 * count, wrong


@pytest.mark.timeout(1200)
def test_what_did_not_change_is_not_named(record_property: Figure) -> None:
    named, count = 0, size(10, 100)
    for seed in range(count):
        graph = random_graph(seed)
        named += bool(grown_parts(joined(graph), joined(replace(graph, seed=seed + 10_000))))
    record_property("figure", f"named although nothing changed: {named} of {count}")
    assert named <= 0.1 * count
