"""Each key reaches the plan, and what makes two plans measure the same."""

from __future__ import annotations

import inspect
import re
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

import msgspec
import pytest

from r2bspec.language import spec, spec_benchmark, spec_graph
from r2bspec.language.node_kinds import NODE_KINDS
from r2bspec.language.quantities import Duration
from r2bspec.plan import command_lines, plan
from r2bspec.plan.comparability import (
    change_of,
    difference_lines,
    graph_differences,
    load_differences,
    measured_hash,
    pair_count,
    single_run_plan,
)
from r2bspec.plan.plan import GatePlan, NodePlan, Plan, PlayPlan, ProcessPlan, SearchPlan
from run_simulation import Simulation, objective

# No key is accepted and ignored: each reaches the plan, and something that runs reads it there.


PACKAGE = Path(__file__).parents[3] / "r2bspec"
COMPILER = ("language", "plan")
"""What only hands a field on. To be read here is not to be used."""

LANGUAGE = (spec, spec_benchmark, spec_graph)

NOT_IN_PLAN = {
    "Spec.r2bspec": "the version of the language: read before there is a plan",
    "Spec.tune": "read by the search, which plays other specs",
    **{f"Tune.{name}": "read by the search" for name in spec_benchmark.Tune.__struct_fields__},
    "DataLoader.bag": "read through DataLoader.sources",
    "DataLoader.bags": "read through DataLoader.sources",
    **{
        f"GateBase.{name}": "how the base is built: read by the merge gate, of the base's spec"
        for name in spec_benchmark.GateBase.__struct_fields__
    },
    "Gate.base": "read by the merge gate",
}
EVALUATED_WHILE_LOADING = ("Matrix", "VariableDeclaration", "RateRange")
"""Records that a `Spec` does not have: they become cases, values and rates."""

PROSE = re.compile(r'"""[\s\S]*?"""|#.*')
ATTRIBUTE_READ = re.compile(r"(?<=[\w)\]])\.(\w+)(?!\w| = )")

NOT_READ_BY_FIELD = {
    "Plan.r2bspec_plan": "the version of the format: checked before a plan is decoded",
    "CallPlan.each": "is read by `CallPlan.requests`",
    "Plan.generator": "names the version that compiled a plan file, for its reader",
}


def structs(*modules: ModuleType) -> list[type[msgspec.Struct]]:
    return [
        member
        for module in modules
        for _, member in inspect.getmembers(module, inspect.isclass)
        if issubclass(member, msgspec.Struct) and member.__module__ == module.__name__
    ]


def attributes_read(*, inside: tuple[str, ...] = (), outside: tuple[str, ...] = ()) -> set[str]:
    """The names of all attributes that the packages inside read, or all but those outside."""
    names: set[str] = set()
    for file in PACKAGE.rglob("*.py"):
        package = file.relative_to(PACKAGE).parts[0]
        if package in inside or (outside and package not in outside):
            code = PROSE.sub("", file.read_text(encoding="utf-8"))
            names.update(ATTRIBUTE_READ.findall(code))
    return names


def test_something_outside_the_compiler_reads_every_field_of_a_plan() -> None:
    read = attributes_read(outside=COMPILER)
    unread = {
        f"{struct.__name__}.{name}"
        for struct in structs(plan)
        for name in struct.__struct_fields__
        if not {name, f"{name}_ns"} & read
    }
    assert unread == NOT_READ_BY_FIELD.keys(), "a key that does nothing, or an exception too many"
    assert "drain_timeout" in read
    assert "no_such_field_ns" not in read


def test_the_compiler_reads_every_key_of_the_language() -> None:
    read = attributes_read(inside=("plan",)) | fields_of_whole_structs()
    unread = {
        f"{struct.__name__}.{name}"
        for struct in structs(*LANGUAGE)
        for name in struct.__struct_fields__
        if struct.__name__ not in EVALUATED_WHILE_LOADING and name not in read
    }
    assert unread <= NOT_IN_PLAN.keys()


def test_each_kind_of_node_that_is_started_has_a_command_line() -> None:
    started = {kind.name for kind in NODE_KINDS if kind.role}
    assert command_lines._ARGV.keys() == started


def fields_of_whole_structs() -> set[str]:
    """The keys of structs of the language that a plan holds as they are, is itself, or inherits."""
    inherited = [
        record
        for record in structs(*LANGUAGE)
        if any(issubclass(struct, record) for struct in structs(plan))
    ]
    hints = " ".join(
        str(hint)
        for record in (*structs(plan), *inherited)
        for hint in inspect.get_annotations(record).values()
    )
    return {
        name
        for record in structs(*LANGUAGE)
        if record in inherited or re.search(rf"\b{record.__name__}\b", hints)
        for name in record.__struct_fields__
    }


# One pair's share of a plan, and what makes two plans measure the same.


PLAY = PlayPlan(rate_hz=30.0, duration_ns=10**9, iterations=7, max_iterations=28)
PLAN = msgspec.structs.replace(
    Simulation().plan(),
    play=(PLAY,),
    play_at_peak=PLAY,
    search=SearchPlan(min_hz=1, max_hz=100, precision=0.02, probe_ns=10**9, holds=()),
    phases=("load", "start", "search", "play", "collect"),
    starts=5,
)


def test_a_run_of_a_pair_plays_everything_once_and_confirms_nothing() -> None:
    found = single_run_plan(PLAN)
    assert [(each.iterations, each.max_iterations) for each in found.play] == [(1, 0)]
    assert found.play_at_peak == msgspec.structs.replace(PLAY, iterations=1, max_iterations=0)
    assert found.starts == 1
    assert not found.gate.confirm
    assert found.search is None
    assert "search" not in found.phases
    assert pair_count(PLAN) == 7
    assert pair_count(msgspec.structs.replace(PLAN, play=(), play_at_peak=None)) == 1


def test_the_peak_is_searched_for_where_an_objective_asks_for_it() -> None:
    asking = {"peak": objective("peak.rate >= 97 % of baseline", at="")}
    found = single_run_plan(msgspec.structs.replace(PLAN, objectives=asking))
    assert found.search == PLAN.search
    assert "search" in found.phases


def test_words_and_judgement_do_not_change_what_is_measured() -> None:
    other = msgspec.structs.replace(
        PLAN,
        title="Another",
        labels={"a": "b"},
        monitors=tuple(msgspec.structs.replace(each, label="Tags") for each in PLAN.monitors),
        objectives={"o": objective("latency.p50 < 1 s")},
        gate=GatePlan(confidence=0.9),
    )
    assert measured_hash(other) == measured_hash(PLAN)
    assert graph_differences(PLAN, other) == load_differences(PLAN, other) == []
    longer = msgspec.structs.replace(PLAN, warm_up=Duration(2))
    assert measured_hash(longer) != measured_hash(PLAN)
    assert [str(difference) for difference in load_differences(PLAN, longer)] == [
        'warm_up: "1 s" -> "2 ns"'
    ]


def test_of_every_field_it_is_known_what_it_changes() -> None:
    assert {*map(change_of, Plan.__struct_fields__)} == {"load", "graph", "neither"}
    assert [change_of(name) for name in ("warm_up", "drain_timeout")] == ["load", "graph"]
    with pytest.raises(KeyError):
        change_of("a_field_of_tomorrow")


def relay(argv: Sequence[str], **parameters: object) -> Plan:
    node = NodePlan(
        name="/relay", node="relay", namespace="/", target="", parameters=parameters, remappings={}
    )
    process = ProcessPlan(
        name="relay", role="command", phase="measure", argv=tuple(argv), env={}, nodes=(node,)
    )
    return msgspec.structs.replace(PLAN, processes=(process,))


def test_a_parameter_that_differs_is_one_difference() -> None:
    base = relay(["relay", "-p", "gain:=1", "-p", "name:=a"], gain=1, name="a")
    head = relay(["relay", "-p", "gain:=2", "-p", "name:=a"], gain=2, name="a")
    only = "processes.relay.nodes['/relay'].parameters.gain"
    assert [str(each) for each in graph_differences(base, head)] == [f"{only}: 1 -> 2"]
    without = relay(["relay", "-p", "name:=a"], name="a")
    assert [str(each) for each in graph_differences(without, head)] == [f"{only}: (absent) -> 2"]


def test_a_command_line_that_differs_in_more_than_parameters_is_shown() -> None:
    base = relay(["relay", "-p", "gain:=1"], gain=1)
    head = relay(["relay", "--fast", "-p", "gain:=2"], gain=2)
    assert any(each.path[2] == "argv" for each in graph_differences(base, head))
    alone = relay(["relay", "-p", "gain:=2"], gain=1)
    assert [each.path[2] for each in graph_differences(base, alone)] == ["argv"]


def test_a_graph_may_differ_where_its_load_may_not() -> None:
    other = msgspec.structs.replace(PLAN, namespace="other")
    assert load_differences(PLAN, other) == []
    (difference,) = graph_differences(PLAN, other)
    assert list(difference_lines([difference] * 14))[-1] == "2 more differences"
