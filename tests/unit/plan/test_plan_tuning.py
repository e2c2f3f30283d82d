"""The deployments that can be tried: what is a lever, what is not, and that each is valid."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest
import yaml

from r2bspec.check.check_context import DocumentFiles
from r2bspec.check.engine import check, context_of
from r2bspec.check.usable_settings import usable_space, without_refused
from r2bspec.diagnostics import Severity
from r2bspec.language.load_spec import load_spec
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.language.variables import assigned_path
from r2bspec.plan.derive_space import PLACEMENT, derive_space
from r2bspec.plan.this_machine import SchedulingFacts
from r2bspec.plan.tuning_space import Lever, Setting, TuningSpace, assignment

SPECS = Path(__file__).parents[3] / "specs"
FOUR_CPUS = SchedulingFacts(cpus=(0, 1, 2, 3), realtime_priority=99, lowest_nice=-20)
NO_PERMISSION = SchedulingFacts(cpus=(0, 1))
GROUPS = (
    *("placement", "containers", "executor", "threads", "cpus", "nice", "scheduling", "qos"),
    *("transport", "intra_process", "environment"),
)

HERE = Path(__file__).parent
CHAIN = (HERE / "chain.r2b.yaml").read_text(encoding="utf-8")
CASES = yaml.safe_load((HERE / "levers.yaml").read_text(encoding="utf-8"))


def space_of(
    text: str | Path, *sets: str, facts: SchedulingFacts = NO_PERMISSION, largest: int = 0
) -> TuningSpace:
    context = context_of(load_spec(text, sets=sets))
    assert context is not None, [each.message for each in load_spec(text, sets=sets).diagnostics]
    return derive_space(context.spec, context.wiring, facts, largest_message_bytes=largest)


def lever(space: TuningSpace, name: str) -> list[str]:
    return [each.text for one in space.levers if one.name == name for each in one.settings]


def errors(text: str | Path, sets: Sequence[str], files: DocumentFiles | None = None) -> list[str]:
    loaded = load_spec(text, sets=sets)
    found = check(loaded, context=context_of(loaded, files=files))
    return [f"{each.code} {each.message}" for each in found if each.severity is Severity.ERROR]


def with_placement(space: TuningSpace, one: Lever) -> tuple[str, ...]:
    """What makes a lever apply."""
    places = one.only_with.get(PLACEMENT, (0,))
    return next(
        (each.settings[places[0]].sets for each in space.levers if each.name == PLACEMENT), ()
    )


@pytest.mark.parametrize(
    ("spec", "levers"),
    [
        ("relay.r2b.yaml", ()),
        ("relay.r2b.yaml", GROUPS),
        ("suite/disparity_graph.r2b.yaml", GROUPS),
        ("reference/live_graph.r2b.yaml", GROUPS),
        ("templates/components.r2b.yaml", GROUPS),
        ("templates/executable.r2b.yaml", GROUPS),
        ("templates/timeline.r2b.yaml", GROUPS),
    ],
)
def test_the_spec_is_valid_with_every_setting(spec: str, levers: tuple[str, ...]) -> None:
    asked = (f"tune.levers=[{', '.join(levers)}]",) if levers else ()
    space = space_of(SPECS / spec, *asked, facts=FOUR_CPUS, largest=7_000_000)
    assert space.levers
    files = DocumentFiles((SPECS / spec).parent)
    for one in space.levers:
        for setting in one.settings[1:]:
            sets = (*asked, *with_placement(space, one), *setting.sets)
            assert errors(SPECS / spec, sets, files) == [], setting


@pytest.mark.parametrize("case", CASES, ids=lambda case: case["name"])
def test_what_can_be_varied_and_what_is_left_out(case: dict[str, Any]) -> None:
    sets = case.get("sets", [])
    space = space_of(CHAIN, *sets, facts=FOUR_CPUS if case.get("permitted") else NO_PERMISSION)
    assert {name: lever(space, name) for name in case["levers"]} == case["levers"]
    for part in case.get("left_out", []):
        assert any(part in why for why in space.left_out)
    deployments = [
        space.deployment({one.name: place})
        for one in space.levers
        for place in range(len(one.settings))
    ]
    for_others = any([*each.for_others()] for each in deployments)
    assert for_others == case.get("for_others", for_others)
    for one in space.levers if case.get("valid") else ():
        for setting in one.settings:
            assert errors(CHAIN, (*sets, *with_placement(space, one), *setting.sets)) == []


def test_a_setting_has_an_effect_only_where_its_process_is_there() -> None:
    space = space_of(CHAIN, "tune.levers=[placement, containers, threads]")
    moved = {PLACEMENT: 2, "graph.nodes.first.threads": 1, "containers.first_group.threads": 1}
    assert [each.lever for each in space.deployment(moved).choices] == [
        PLACEMENT,
        "containers.first_group.threads",
    ]
    # 2 threads or one, of 3 nodes; of none; of one node and a container; of one container.
    assert space.size == 2**3 + 1 + 2**2 + 2
    assert errors(CHAIN, space.deployment(moved).sets) == []


@pytest.mark.parametrize(
    ("own", "replaced", "left"),
    [
        ("transport.segment: [8 MB]", ["transport"], [PLACEMENT, "graph.nodes.first.threads"]),
        (
            "graph.nodes.first.executor: [multi_threaded]",
            ["graph.nodes.first.threads"],
            [PLACEMENT, "graph.nodes.second.threads", "transport"],
        ),
        ("graph.placement: [shared]", [], ["graph.nodes.first.threads", "transport"]),
        ("graph.nodes.first.container: [main]", [PLACEMENT], ["graph.nodes.first.threads"]),
        ("graph.nodes.first.cpus: [[0], [1]]", [], [PLACEMENT, "graph.nodes.first.threads"]),
    ],
)
def test_an_own_lever_replaces_all_that_it_would_disturb(
    tmp_path: Path, own: str, replaced: list[str], left: list[str]
) -> None:
    """One whose keys are the same, above, or below."""
    sets = (f"tune.values={{{own}}}", "containers={main: {executable: python}}")
    space = space_of(CHAIN, *sets, largest=10**6)
    names = [each.name for each in space.levers]
    assert own.partition(":")[0] in names
    assert not {*replaced} & {*names}
    assert {*left} <= {*names}
    assert len({*names}) == len(names)
    file = tmp_path / "chain.r2b.yaml"
    file.write_text(CHAIN)
    selection = SpecSelection(file, sets=sets)
    context = context_of(selection.load())
    assert context is not None
    usable = usable_space(selection, context, NO_PERMISSION, largest_message_bytes=10**6)
    assert usable.size > 2
    for one in usable.levers:
        assert {*one.only_with} <= {each.name for each in usable.levers}
        for place, _ in enumerate(one.settings):
            found = usable.deployment({one.name: place})
            paths = [assigned_path(each) for each in found.sets]
            assert len({*paths}) == len(paths)


def test_of_many_nodes_few_have_levers() -> None:
    node = "{{python: r2bspec.nodes.RelayNode, remappings: {{input: t{}, output: t{}}}}}"
    nodes = "".join(f"    n{i}: {node.format(i, i + 1)}\n" for i in range(100))
    text = CHAIN[: CHAIN.index("    small:")] + nodes + CHAIN[CHAIN.index("monitors:") :]
    space = space_of(
        text.replace("    image: {from", "    t0: {from").replace("topic: seen", "topic: t100")
    )
    assert len(lever(space, PLACEMENT)) <= 6
    assert len(space.levers) < 40
    assert any("processes have no levers of their own" in why for why in space.left_out)


NODE_FILE = """
import rclpy
from rclpy.node import Node
from sensor_msgs.msg import Image


class Plain(Node):
    def __init__(self):
        super().__init__("plain")


def main():
    rclpy.init()
    rclpy.spin(Plain())
"""


@pytest.mark.parametrize(
    ("name", "reasons"),
    [
        ("Plain", ["graph.placement, first with others: a constructor without **kwargs"]),
        ("main", ["graph.placement, first with others: what initialises", "threads of first: "]),
    ],
)
def test_code_that_shares_no_process_is_left_out(
    name: str, reasons: list[str], tmp_path: Path
) -> None:
    (tmp_path / "nodes.py").write_text(NODE_FILE)
    spec = tmp_path / "x.r2b.yaml"
    ends = "subscribes: {image: sensor_msgs/msg/Image}, publishes: {between: sensor_msgs/msg/Image}"
    first = f"    first: {{python: './nodes.py:{name}', {ends}}}\n"
    before, second = CHAIN.split("    first:\n")
    spec.write_text(before + first + second[second.index("    second:") :])
    left_out = space_of(spec).left_out
    assert all(any(why.startswith(reason) for why in left_out) for reason in reasons), left_out


def test_what_is_refused_is_left_out() -> None:
    def setting(name: str) -> Setting:
        return Setting(text=name, sets=(name,))

    now = Setting(text="now")
    space = TuningSpace(
        levers=(
            Lever(name=PLACEMENT, settings=(now, setting("bad"), setting("good"))),
            Lever(name="a", settings=(now, setting("a1")), only_with={PLACEMENT: (1,)}),
            Lever(name="b", settings=(now, setting("b1")), only_with={PLACEMENT: (2,)}),
            Lever(name="c", settings=(now, setting("worse"), setting("c2"))),
        )
    )
    tried: list[Sequence[str]] = []

    def refusal(sets: Sequence[str]) -> str:
        tried.append(sets)
        return "R2B000: no" if {"bad", "worse"} & {*sets} else ""

    usable = without_refused(space, refusal)
    left = [(one.name, len(one.settings)) for one in usable.levers]
    assert left == [(PLACEMENT, 2), ("b", 2), ("c", 2)]
    assert usable.levers[1].only_with == {PLACEMENT: (1,)}
    assert usable.left_out == (f"{PLACEMENT} = bad and 1 more: R2B000: no",)


def test_nothing_depends_on_a_lever_of_which_one_setting_is_left() -> None:
    other = (Setting(text="now"), Setting(text="b", sets=("b",)))
    placement = Lever(name=PLACEMENT, settings=(other[0], Setting(text="bad", sets=("bad",))))
    levers = [
        Lever(name=name, settings=other, only_with={PLACEMENT: (at,)})
        for name, at in (("a", 0), ("b", 1))
    ]
    space = TuningSpace(levers=(placement, *levers))
    usable = without_refused(space, lambda sets: "no" if "bad" in sets else "")
    assert [(one.name, one.only_with) for one in usable.levers] == [("a", {})]


@pytest.mark.parametrize(
    "value", ["udp", "1", "true", "[x", "a b", "", 1, True, 0.5, [0, 1], "é'\""]
)
def test_an_assignment_means_its_value(value: object) -> None:
    written = assignment(("graph", "nodes", "first", "parameters", "p"), value)
    spec = load_spec(CHAIN, sets=[written]).spec
    assert spec is not None
    assert spec.graph.nodes["first"].parameters["p"] == value
