"""A gate cannot weaken itself: each key, each spec of a set, and how the pipeline allows it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, get_args, get_type_hints

import msgspec
import pytest

from compared_gates import DOCUMENT, GONE, IMAGE, side, with_value
from r2bspec.compare import gate_keys
from r2bspec.compare.gate_change import GateKey
from r2bspec.compare.gate_strength import (
    MissingObjectivesError,
    WeakerGateError,
    allowable_names,
    check_allowed,
    check_gate,
    compare_gates,
    require_objectives,
    weakening_diagnostics,
)
from r2bspec.compare.merge_gate import SpecName, missing_specs, spec_name
from r2bspec.compare.objective_strength import implies
from r2bspec.errors import UsageError
from r2bspec.language import spec as language
from r2bspec.language.comparison_grammar import parse_requirement
from r2bspec.language.declaration import rule_at
from r2bspec.language.load_spec import load_cases
from r2bspec.language.yaml_document import to_yaml
from r2bspec.plan import plan as plans
from r2bspec.plan.plan import Plan
from r2bspec.plan.prepared_benchmark import PreparedBenchmark
from r2bspec.plan.smoke_plan import smoke_plan

# A gate cannot weaken itself: each key, weaker and stronger, and how the pipeline allows it.


BENCHMARK = ("benchmark",)
GATE = ("benchmark", "gate")
SEARCH = ("benchmark", "search")
FAST = ("slos", "fast")
RELAY = ("graph", "nodes", "relay")
ONE_INPUT = {"image": DOCUMENT["playback"]["inputs"]["image"]}

ENDS = ("accepted", "feedback")

BOTH_WAYS: list[tuple[tuple[str | int, ...], Any, Any, str]] = [
    # path, weaker value, stronger value, name
    ((*BENCHMARK, "duration"), "2 s", "4 s", "duration"),
    ((*BENCHMARK, "iterations"), 8, 10, "iterations"),
    ((*BENCHMARK, "max_iterations"), 15, 20, "max_iterations"),
    ((*BENCHMARK, "max_iterations"), GONE, 20, "max_iterations"),
    ((*BENCHMARK, "starts"), 2, 5, "starts"),
    ((*BENCHMARK, "rates"), ["30 Hz"], ["10 Hz", "30 Hz"], "rates"),
    ((*BENCHMARK, "warm_up"), "3 s", "2 s", "warm_up"),
    ((*BENCHMARK, "start_timeout"), "60 s", "30 s", "start_timeout"),
    ((*BENCHMARK, "drain_timeout"), "20 s", "5 s", "drain_timeout"),
    ((*SEARCH, "min"), "10 Hz", "5 Hz", "search"),
    ((*SEARCH, "max"), "50 Hz", "60 Hz", "search"),
    ((*SEARCH, "precision"), "5 %", "2 %", "search"),
    ((*SEARCH, "probe"), "4 s", "5 s", "search"),
    ((*SEARCH, "confirm"), "10 s", "20 s", "search"),
    ((*SEARCH, "confidence"), "90 %", "95 %", "search"),
    ((*SEARCH, "holds"), ["out.drop_rate <= 9 %"], ["out.drop_rate <= 5 %"], "search"),
    ((*SEARCH, "holds"), [], ["out.drop_rate <= 5 %"], "search"),
    ((*GATE, "confidence"), "90 %", "95 %", "confidence"),
    ((*GATE, "inconclusive"), "report", "fail", "gate.inconclusive"),
    ((*GATE, "inconclusive"), "pass", "report", "gate.inconclusive"),
    ((*GATE, "confirm"), True, False, "gate.confirm"),
    ((*GATE, "time_budget"), "5 min", "10 min", "gate.time_budget"),
    ((*GATE, "time_budget"), "10 min", GONE, "gate.time_budget"),
    ((*GATE, "interference"), "tolerate", "note", "gate.interference"),
    ((*GATE, "interference"), "tolerate", "note", "gate.interference"),
    (("playback", "unpaired"), "drop", "refuse", "playback"),
    (("monitors", "third"), GONE, {"topic": "third", "format": IMAGE}, "monitor third"),
    ((*RELAY, "memory_limit"), "300 MiB", "200 MiB", "memory_limit relay"),
    ((*RELAY, "memory_limit"), GONE, "200 MiB", "memory_limit relay"),
    ((*FAST, "require", 1), GONE, "out.drop_rate <= 1 %", "objective fast"),
    ((*FAST, "level"), "warn", "error", "objective fast"),
    ((*FAST, "level"), "off", "error", "objective fast"),
    ((*FAST, "when"), {"threads": 1}, GONE, "objective fast"),
    ((*FAST, "when"), {"threads": 2}, GONE, "objective fast"),
    ((*FAST, "confidence"), "90 %", GONE, "objective fast"),
    ((*FAST, "confidence"), GONE, "99 %", "objective fast"),
    (("slos", "fast"), GONE, DOCUMENT["slos"]["fast"], "objective fast"),
]
BOTH_WAYS += [
    (("slos", objective, "require", 0), weaker, stronger, f"objective {objective}")
    for objective, weaker, stronger in (
        ("fast", "out.latency.p90 < 60 ms", "out.latency.p90 < 50 ms"),
        ("fast", "out.latency.p90 <= 50 ms", "out.latency.p90 < 50 ms"),
        ("headroom", "peak.rate >= 39 Hz", "peak.rate >= 40 Hz"),
        (
            "relative",
            "out.latency.p50 <= 110 % of baseline",
            "out.latency.p50 <= 105 % of baseline",
        ),
        ("steady", "throughput.mean >= 90 % of offered", "throughput.mean >= 97 % of offered"),
        ("steady", "out.throughput.mean >= 97 % of offered", "throughput.mean >= 97 % of offered"),
        ("windowed", *(f"out.latency.p90 < 60 ms in {n} % of 1 s windows" for n in (98, 99))),
    )
]

WITHOUT_ORDER: list[tuple[tuple[str | int, ...], Any, str]] = [
    # path, another value, name
    (("playback", "mode"), "sweeping", "playback"),
    (("playback", "buffer"), 5, "playback"),
    (("playback", "clock"), True, "playback"),
    (("playback", "pairing"), {"slop": "5 ms"}, "input image"),
    (("playback", "inputs"), ONE_INPUT, "input info"),
    (("playback", "inputs", "image", "from"), "image_raw", "input image"),
    (("playback", "inputs", "image", "qos"), {"reliability": "best_effort"}, "input image"),
    (("playback", "inputs", "image", "timestamp"), "none", "input image"),
    (("playback", "inputs", "info", "rate"), "recorded", "input info"),
    (("preprocessors", "resize", "parameters", "width"), 64, "preprocessors"),
    (("preprocessors", "second"), {"external": True}, "preprocessors"),
    (("data_loader", "bag", "path"), "./garden", "data"),
    (("data_loader", "window", "start"), "1 s", "data"),
    (("data_loader", "window", "end"), "2 s", "data"),
    (("data_loader", "window", "end"), GONE, "data"),
    (("data_loader", "topics"), {"/camera/image": "image_raw"}, "data"),
    (("data_loader", "publish_tf"), True, "data"),
    (("data_loader", "real_time"), True, "data"),
    (("data_loader", "bag", "sha256"), "0" * 64, "data"),
    (("monitors", "out", "topic"), "elsewhere", "monitor out"),
    (("monitors", "out", "format"), "sensor_msgs/msg/CompressedImage", "monitor out"),
    (("monitors", "out", "match"), "order", "monitor out"),
    (("monitors", "out", "ratio"), {"inputs": 2, "outputs": 1}, "monitor out"),
    (("monitors", "out", "qos"), {"depth": 1}, "monitor out"),
    (("monitors", "out", "truth"), {"kind": "tag", "name": "image"}, "monitor out"),
    (("transport",), "udp", "transport"),
    (("transport",), {"kind": "shared_memory", "segment": "64 MiB"}, "transport"),
    (("harness",), "shared", "harness"),
    (("requires",), {"cores": 64}, "requires"),
    ((*FAST, "at"), "10 Hz", "objective fast"),
    ((*FAST, "require", 0), "out.latency.p50 < 20 ms", "objective fast"),
    ((*FAST, "require", 0), "out.latency.p90 < 50 % of baseline", "objective fast"),
    ((*FAST, "require", 0), "out.latency.p90 < 50 ms in 99 % of 1 s windows", "objective fast"),
    (("slos", "windowed", "require", 0), "out.latency.p90 < 60 ms", "objective windowed"),
]

FREE: list[tuple[tuple[str | int, ...], Any]] = [
    (("title",), "Another title"),
    (("description",), "Another description"),
    (("labels",), {"sensor": "camera"}),
    (("name",), "another"),
    ((*RELAY, "python"), "./other.py:Relay"),
    ((*RELAY, "parameters"), {"depth": 3}),
    (("graph", "nodes", "third"), {"python": "r2bspec.nodes.RelayNode"}),
    (("graph", "nodes", "second"), GONE),
    (("setup",), {"build": {"command": ["make"]}}),
    (("ready",), {"up": {"file": "ready"}}),
    (("environment",), ["MODEL"]),
    (("monitors", "out", "label"), "detections"),
    (("monitors", "out", "taps"), True),
    (("variables", "unused"), 3),
    (("slos", "hint"), {"at": "30 Hz", "level": "warn", "require": ["out.latency.p50 < 1 ms"]}),
]


def names(base: PreparedBenchmark, head: PreparedBenchmark) -> set[str]:
    """The names of what is weaker in the head."""
    return {each.name for each in compare_gates(base, head).weaker}


def sides(path: tuple[str | int, ...], *values: Any) -> list[PreparedBenchmark]:
    return [side(with_value(DOCUMENT, path, value)) for value in values]


@pytest.mark.parametrize(("path", "weak", "strong", "name"), BOTH_WAYS)
def test_a_key_with_an_order_is_weaker_one_way_and_stronger_the_other(
    path: tuple[str | int, ...], weak: Any, strong: Any, name: str
) -> None:
    weaker, stronger = sides(path, weak, strong)
    assert names(stronger, weaker) == {name}
    assert name in allowable_names(stronger, weaker)
    other = compare_gates(weaker, stronger)
    assert other.weaker == ()
    assert any(each.startswith(f"{name} (") for each in other.stronger)


@pytest.mark.parametrize(("path", "value", "name"), WITHOUT_ORDER)
def test_a_change_without_an_order_counts_as_weaker(
    path: tuple[str | int, ...], value: Any, name: str
) -> None:
    base, changed = side(DOCUMENT), side(with_value(DOCUMENT, path, value))
    weaker = names(base, changed)
    assert name in (weaker | names(changed, base) if path[-1] == "sha256" else weaker)
    assert weaker <= set(allowable_names(base, changed))


@pytest.mark.parametrize(("path", "value"), FREE)
def test_the_graph_and_its_words_are_free_to_change(
    path: tuple[str | int, ...], value: Any
) -> None:
    changed = side(with_value(DOCUMENT, path, value))
    assert compare_gates(side(DOCUMENT), changed).weaker == ()
    assert compare_gates(changed, side(DOCUMENT)).weaker == ()


ADD: dict[str, Any] = {"service": {"name": "add", "type": "p/srv/Add", "request": {"a": 1}}}
PLAN: dict[str, Any] = {"action": {"name": "plan", "type": "p/action/Plan"}, "feedback": True}


@pytest.mark.parametrize(
    ("calls", "weaker"),
    [
        ({"add": ADD, "plan": PLAN}, set()),
        ({"add": ADD}, {"call plan", "monitor plan", *(f"monitor plan_{n}" for n in ENDS)}),
        ({"add": {"service": {**ADD["service"], "request": {}}}, "plan": PLAN}, {"call add"}),
        ({"add": {**ADD, "success": "done"}, "plan": PLAN}, {"call add"}),
        ({"add": ADD, "plan": {"action": PLAN["action"]}}, {"call plan", "monitor plan_feedback"}),
    ],
    ids=["same", "gone", "request", "success", "feedback"],
)
def test_another_call_is_a_weaker_gate(calls: dict[str, Any], weaker: set[str]) -> None:
    def calling(called: dict[str, Any]) -> PreparedBenchmark:
        rest = {key: DOCUMENT[key] for key in ("r2bspec", "name", "graph")}
        return side({**rest, "playback": {"calls": called}, "benchmark": {"rates": ["10 Hz"]}})

    assert names(calling({"add": ADD, "plan": PLAN}), calling(calls)) == weaker


def test_objectives_and_monitors_are_compared_by_content() -> None:
    renamed = with_value(DOCUMENT, ("slos", "fast"), GONE)
    renamed = with_value(renamed, ("slos", "quick"), DOCUMENT["slos"]["fast"])
    assert compare_gates(side(DOCUMENT), side(renamed)).weaker == ()
    text = json.dumps(with_value(DOCUMENT, ("monitors", "other"), GONE)).replace("out.", "result.")
    moved = with_value(json.loads(text), ("monitors", "out"), GONE)
    moved = with_value(moved, ("monitors", "result"), DOCUMENT["monitors"]["out"])
    assert names(side(DOCUMENT), side(moved)) == {"monitor other"}


def test_an_objective_may_be_implied_by_another_one() -> None:
    tight = {"at": "30 Hz", "require": ["out.latency.p90 < 20 ms", "out.drop_rate == 0 %"]}
    merged = with_value(with_value(DOCUMENT, FAST, GONE), ("slos", "tight"), tight)
    assert names(side(DOCUMENT), side(merged)) == set()


def test_a_variable_that_switches_an_objective_off_is_weaker() -> None:
    conditional = with_value(DOCUMENT, (*FAST, "when"), {"threads": 1})
    switched = with_value(conditional, ("variables", "threads"), 2)
    weaker = compare_gates(side(conditional), side(switched)).weaker
    assert {each.name for each in weaker} == {"objective fast"}
    assert weaker[0].after.endswith("when threads=1, not active")


def test_an_objective_that_applies_elsewhere_is_compared_too() -> None:
    elsewhere = with_value(DOCUMENT, (*FAST, "when"), {"threads": 2})
    looser = with_value(elsewhere, (*FAST, "require", 0), "out.latency.p90 < 1 s")
    assert names(side(elsewhere), side(looser)) == {"objective fast"}


def test_starts_that_follow_from_the_iterations_have_no_name_of_their_own() -> None:
    short = with_value(
        with_value(DOCUMENT, (*BENCHMARK, "starts"), GONE), (*BENCHMARK, "max_iterations"), GONE
    )
    fewer = with_value(short, (*BENCHMARK, "iterations"), 2)
    assert names(side(short), side(fewer)) == {"iterations"}


@pytest.mark.parametrize(
    ("stronger", "weaker", "expected"),
    [
        ("sustained", "sustained", True),
        ("sent > 3", "sustained", False),
    ],
)
def test_a_requirement_without_a_bound_implies_itself_alone(
    stronger: str, weaker: str, expected: bool
) -> None:
    assert implies(parse_requirement(stronger), parse_requirement(weaker)) is expected


ONE_CALL = plans.CallPlan(name="", target="", type="", request={})


class TestNoFieldIsForgotten:
    """A new field of a plan is a decision: of the gate, or free."""

    def test_every_field_of_a_plan_is_compared_or_free(self) -> None:
        fields = set(Plan.__struct_fields__)
        assert fields >= set(gate_keys.GATE_FIELDS) | gate_keys.FREE_FIELDS
        others = fields - set(gate_keys.GATE_FIELDS)
        assert {field for field in others if not gate_keys.is_free(field)} == set()

    def test_a_field_of_the_load_or_of_judging_is_not_free_by_itself(
        self, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(gate_keys, "GATE_FIELDS", {})
        assert not any(map(gate_keys.is_free, ("buffer", "objectives")))

    @pytest.mark.parametrize(
        ("struct", "fields"),
        [
            (plans.GatePlan, set(gate_keys.GATE_KEYS)),
            (plans.PlayPlan, {*gate_keys.PLAY_KEYS, "rate_hz"}),
            (plans.SearchPlan, {*gate_keys.SEARCH_KEYS, "holds"}),
            (language.Objective, {"at", "level", "when", "confidence", "require", "at_peak"}),
        ],
    )
    def test_every_field_with_an_order_has_a_key(
        self, struct: type[msgspec.Struct], fields: set[str]
    ) -> None:
        assert fields == set(struct.__struct_fields__)

    @pytest.mark.parametrize(
        ("struct", "path", "keys", "unchanged"),
        [
            (plans.DatasetPlan, ("data_loader",), gate_keys.DATA_KEYS, ()),
            (
                *(plans.InputPlan, ("playback", "inputs", "image")),
                *(gate_keys.input_keys("image"), ("topic",)),
            ),
            (
                *(plans.CallPlan, ("playback", "calls", "call")),
                *(gate_keys.call_keys(ONE_CALL), ()),
            ),
            (
                *(plans.MonitorPlan, ("monitors", "out"), gate_keys.MONITOR_KEYS),
                tuple(gate_keys.FREE_MONITOR_FIELDS),
            ),
            (plans.TimelinePlan, ("playback",), gate_keys.TIMELINE_KEYS, ()),
        ],
    )
    def test_a_change_of_every_other_field_is_named_by_its_key(
        self,
        struct: type[msgspec.Struct],
        path: tuple[str, ...],
        keys: Mapping[str, str | GateKey],
        unchanged: tuple[str, ...],
    ) -> None:
        for field in set(struct.__struct_fields__) - set(unchanged):
            name = keys.get(field, field)
            place = (*path, *name.split(".")) if isinstance(name, str) else name.path
            assert rule_at(place) is not None, field

    @pytest.mark.parametrize("field", ["inconclusive", "interference"])
    def test_every_choice_of_the_gate_has_a_rank(self, field: str) -> None:
        choices = get_args(get_type_hints(plans.GatePlan)[field])
        order = gate_keys.GATE_KEYS[field].order
        assert order is not None
        assert sorted(map(order, choices)) == list(range(len(choices)))

    @pytest.mark.parametrize(
        ("keys", "field", "path", "values", "name"),
        [
            ("GATE_FIELDS", "harness", ("harness",), ("separate", "shared"), "harness"),
            (
                "GATE_KEYS",
                "interference",
                (*GATE, "interference"),
                ("tolerate", "note"),
                "gate.interference",
            ),
            ("PLAY_KEYS", "iterations", (*BENCHMARK, "iterations"), (8, 10), "iterations"),
        ],
    )
    def test_a_field_that_nobody_decided_about_is_weaker_under_its_name(
        self,
        monkeypatch: pytest.MonkeyPatch,
        keys: str,
        field: str,
        path: tuple[str, ...],
        values: tuple[Any, Any],
        name: str,
    ) -> None:
        left = {key: each for key, each in getattr(gate_keys, keys).items() if key != field}
        monkeypatch.setattr(gate_keys, keys, left)
        (weaker,) = compare_gates(*sides(path, *values)).weaker
        assert weaker.name == name
        assert str(values[0]) in weaker.before
        assert str(values[1]) in weaker.after


class TestWaivers:
    TEXT = (
        "r2bspec: 1\nname: relay\n"
        "data_loader: {bag: {path: ./kitchen}, topics: {/camera/image: raw}}\n"
        f"playback: {{inputs: {{image: {{from: raw, format: {IMAGE}}}}}}}\n"
        "graph:\n  nodes:\n    relay:\n      python: r2bspec.nodes.RelayNode\n"
        "      remappings: {input: image}\n"
        f"monitors: {{out: {{topic: output, format: {IMAGE}}}}}\nbenchmark: {{rates: [30 Hz]}}\n"
    )
    WAIVED = TEXT.replace("    relay:\n", "    relay:  # r2bspec: ignore[R2B207] as intended\n")

    def test_a_new_waiver_is_weaker_and_one_that_is_gone_is_stronger(self) -> None:
        base, head = side(self.TEXT), side(self.WAIVED)
        (weaker,) = compare_gates(base, head).weaker
        assert (weaker.name, weaker.after) == ("waiver R2B207", "as intended")
        (finding,) = weakening_diagnostics([weaker], head.loaded, "main")
        assert finding.span.line == 7
        other = compare_gates(head, base)
        assert (other.weaker, other.stronger) == ((), ("waiver R2B207 (gone, was as intended)",))

    def test_a_waiver_may_move_with_its_key_and_give_another_reason(self) -> None:
        moved = "# a comment\n" + self.WAIVED.replace("as intended", "for a reason")
        assert compare_gates(side(self.WAIVED), side(moved)).weaker == ()

    def test_the_same_waiver_of_another_key_is_new(self) -> None:
        other = self.TEXT.replace(
            "RelayNode\n", "RelayNode  # r2bspec: ignore[R2B207] as intended\n"
        )
        assert names(side(self.WAIVED), side(other)) == {"waiver R2B207"}

    @pytest.mark.parametrize(
        "comment", ["ignore[R2B207]", "ignore[R2B999] reason", "ignore reason"]
    )
    def test_a_waiver_without_an_effect_does_not_count(self, comment: str) -> None:
        void = self.TEXT.replace("    relay:\n", f"    relay:  # r2bspec: {comment}\n")
        assert names(side(self.TEXT), side(void)) == set()


class TestAllowing:
    WEAKER = with_value(
        with_value(DOCUMENT, (*FAST, "require", 0), "out.latency.p90 < 60 ms"),
        (*BENCHMARK, "duration"),
        "2 s",
    )

    def test_what_is_weaker_is_an_error_at_its_line_with_both_values(self) -> None:
        head = side(self.WEAKER)
        with pytest.raises(WeakerGateError) as caught:
            check_gate(side(DOCUMENT), head, base_name="origin/main@9b1e44f")
        error = caught.value
        assert (error.code, error.exit_code) == ("R2B692", 2)
        assert "--allow 'objective fast'" in error.hint
        duration, fast = error.diagnostics
        assert head.loaded is not None
        lines = head.loaded.texts["head.r2b.yaml"].splitlines()
        assert lines[duration.span.line - 1] == "  duration: 2 s"
        assert lines[fast.span.line - 1] == "    - out.latency.p90 < 60 ms"
        assert (
            "out.latency.p90 < 60 ms at 30 Hz, was out.latency.p90 < 50 ms at 30 Hz" in fast.message
        )
        assert "origin/main@9b1e44f" in fast.message
        assert fast.help.endswith("the pipeline can allow it: --allow 'objective fast'")

    def test_what_is_gone_is_reported_at_its_nearest_parent(self) -> None:
        head = side(with_value(DOCUMENT, FAST, GONE))
        with pytest.raises(WeakerGateError) as caught:
            check_gate(side(DOCUMENT), head)
        assert head.loaded is not None
        lines = head.loaded.texts["head.r2b.yaml"].splitlines()
        assert {lines[diagnostic.span.line - 1] for diagnostic in caught.value.diagnostics} == {
            "slos:"
        }
        messages = sorted(diagnostic.message for diagnostic in caught.value.diagnostics)
        assert messages[1].endswith("objective fast: gone, was out.latency.p90 < 50 ms at 30 Hz")

    def test_the_pipeline_allows_by_name(self) -> None:
        base, head = side(DOCUMENT), side(self.WEAKER)
        with pytest.raises(WeakerGateError) as caught:
            check_gate(base, head, ["duration"])
        assert {diagnostic.path[0] for diagnostic in caught.value.diagnostics} == {"slos"}
        comparison = check_gate(base, head, ["duration", "objective fast"])
        assert comparison.sentences[-1] == "allowed: duration (2 s, was 4 s)"

    def test_a_name_that_nothing_has_is_refused_with_those_that_exist(self) -> None:
        base = side(DOCUMENT)
        with pytest.raises(UsageError, match="did you mean 'objective fast'") as caught:
            check_gate(base, base, ["objective fats"])
        assert "monitor out" in caught.value.hint
        check_gate(base, base, ["objective fats"], known_names=["objective fats"])

    @pytest.mark.parametrize("name", ["waiver R2B207", "spec a b.r2b.yaml", "case a[x=1]", "base"])
    def test_names_that_no_single_spec_has_are_accepted(self, name: str) -> None:
        check_gate(side(DOCUMENT), side(DOCUMENT), [name])

    def test_plans_from_files_are_compared_without_places(self) -> None:
        base, head = (replace(side(each), loaded=None) for each in (DOCUMENT, self.WEAKER))
        with pytest.raises(WeakerGateError) as caught:
            check_gate(base, head)
        assert {diagnostic.span.file for diagnostic in caught.value.diagnostics} == {"<plan>"}


Level = Literal["error", "warn", "info", "off"]


@pytest.mark.parametrize("level", ["warn", "info", "off"])
def test_a_plan_that_nothing_can_fail_is_refused(level: Level) -> None:
    plan = side(DOCUMENT).plan
    require_objectives(plan)
    soft = {
        name: msgspec.structs.replace(each, level=level) for name, each in plan.objectives.items()
    }
    for none in (msgspec.structs.replace(plan, objectives=soft), smoke_plan(plan)):
        with pytest.raises(MissingObjectivesError) as caught:
            require_objectives(none)
        assert (caught.value.code, caught.value.exit_code) == ("R2B693", 2)
        assert "slos" in caught.value.hint


# Sets of specs: which belong together, and which are gone.


MATRIX = SpecName("relay", ("x=1", "x=2"))


@pytest.mark.parametrize(
    ("base", "head", "missing"),
    [
        ({"a": "a", "gone": "gone"}, {"a": "other", "new": "new"}, ["spec gone"]),
        ({"bench/moved": "moved"}, {"new/moved": "moved"}, []),
        # A spec that stays at its path is the base of no copy, and one is the base of one.
        ({"a": "same", "b": "same"}, {"a": "same", "c": "same"}, []),
        ({"a": "same", "b": "same", "c": "same"}, {"a": "same", "d": "same"}, ["spec c"]),
        # Specs without a name do not belong together.
        ({"a": ""}, {"b": ""}, ["spec a"]),
    ],
)
def test_specs_belong_together_by_path_and_else_by_name(
    base: dict[str, str], head: dict[str, str], missing: list[str]
) -> None:
    before, after = ({path: SpecName(name) for path, name in each.items()} for each in (base, head))
    assert [change.name for change in missing_specs(before, after)] == missing


def test_a_case_that_is_gone_is_weaker() -> None:
    assert [*missing_specs({"a": MATRIX}, {"a": MATRIX})] == []
    head = {"moved": SpecName("relay", ("x=2", "x=3"))}
    (gone,) = missing_specs({"a": MATRIX}, head)
    assert gone.name == "case relay[x=1]"
    (finding,) = weakening_diagnostics([gone], None, "main")
    assert (finding.span.file, finding.span.line) == ("moved", 1)
    assert finding.help.endswith("--allow 'case relay[x=1]'")
    check_allowed([gone.name], ())


def test_the_name_and_the_cases_are_those_of_the_document() -> None:
    matrix = with_value(DOCUMENT, ("matrix",), {"axes": {"threads": [1, 2]}})
    assert spec_name(load_cases(to_yaml(matrix))) == SpecName("relay", ("threads=1", "threads=2"))
    assert spec_name(load_cases(to_yaml(DOCUMENT))) == SpecName("relay")
    assert spec_name(load_cases("name: [")) == SpecName("")
