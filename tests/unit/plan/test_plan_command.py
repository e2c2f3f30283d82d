"""``r2bspec plan``: what a run will do, and how long it takes."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path

import msgspec
import pytest
from plan_specs import plan

from command_line import Call
from r2bspec.diagnostics.quote import time_text
from r2bspec.plan.canonical_json import read_plan
from r2bspec.plan.plan import GatePlan, PlayPlan, SearchPlan
from r2bspec.plan.time_estimate import estimate_time
from r2bspec.report.findings_text import code_with_slug

# ``r2bspec plan``: what a run will do.


RELAY = Path(__file__).parents[3] / "specs" / "relay.r2b.yaml"


@pytest.fixture(autouse=True)
def without_real_datasets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("R2B_DATASETS", raising=False)


def test_the_plan_goes_to_standard_output_or_to_a_file_that_is_a_plan_again(
    tmp_path: Path, call: Call
) -> None:
    said = call("plan", RELAY, status=0)
    assert json.loads(said.out)["name"] == "relay"
    assert said.err.startswith("a run takes about ")
    file = tmp_path / "relay.json"
    assert call("plan", RELAY, "-o", file, status=0).out == ""
    assert read_plan(file).name == "relay"
    assert call("plan", file, status=0).out == file.read_text(encoding="utf-8")


def test_a_device_is_written_to_and_not_replaced(tmp_path: Path, call: Call) -> None:
    _, device = os.openpty()
    os.set_blocking(device, False)  # nobody reads it
    (link := tmp_path / "out").symlink_to(os.ttyname(device))
    call("plan", RELAY, "-o", link, "--graph", "dot", status=0)
    assert stat.S_ISCHR(link.stat().st_mode)


def test_the_spec_is_not_replaced_by_its_plan(tmp_path: Path, call: Call) -> None:
    spec = tmp_path / "a.r2b.yaml"
    spec.write_text(RELAY.read_text())
    (link := tmp_path / "link").symlink_to(spec)
    before = spec.read_bytes()
    assert "is read" in call("plan", spec, "-o", link, status=2).err
    assert spec.read_bytes() == before


@pytest.mark.parametrize(
    ("form", "begins"),
    [("mermaid", "flowchart LR"), ("dot", "digraph"), ("html", "<!DOCTYPE html>")],
)
def test_it_can_be_drawn(form: str, begins: str, call: Call) -> None:
    said = call("plan", RELAY, "--graph", form, status=0).out
    assert said.startswith(begins)
    assert "/r2b/relay" in said


def test_options_change_the_plan_and_the_difference_shows_it(call: Call) -> None:
    options = ["--var", "service_time_ms=20.0", "--set", "benchmark.iterations=3"]
    ended = call("plan", RELAY, *options, "--diff", RELAY, status=1)
    assert ended.out.splitlines() == [
        "processes.relay.nodes['/r2b/relay'].parameters.service_time_ms: 10.0 -> 20.0",
        "play['50.0'].iterations: 10 -> 3",
        "starts: 5 -> 1",
    ]
    assert call("plan", RELAY, "--diff", RELAY, status=0).out == ""


def test_an_invalid_spec_is_wrong_usage_and_its_findings_are_shown(
    tmp_path: Path, call: Call
) -> None:
    broken = tmp_path / "broken.r2b.yaml"
    text = RELAY.read_text(encoding="utf-8").replace("input: camera_info", "input: camera_inf")
    broken.write_text(text, encoding="utf-8")
    said = call("plan", broken, status=2)
    assert said.out == ""
    assert f"{broken}:" in said.err
    assert f"error[{code_with_slug('R2B207')}]" in said.err
    assert "did you mean 'camera_info'?" in said.err


def test_drawing_and_comparing_exclude_each_other(call: Call) -> None:
    ended = call("plan", RELAY, "--graph", "dot", "--diff", RELAY, status=2)
    assert "cannot be combined" in ended.err


# How long a run is expected to take.


def plays(rates: int, iterations: int, seconds: float, most: int = 0) -> tuple[PlayPlan, ...]:
    return tuple(
        PlayPlan(
            rate_hz=10.0 * number,
            duration_ns=int(seconds * 1e9),
            iterations=iterations,
            max_iterations=most,
        )
        for number in range(1, rates + 1)
    )


def test_what_is_declared_is_counted() -> None:
    base = msgspec.structs.replace(plan(), play=(), search=None, gate=GatePlan(confirm=False))
    without = estimate_time(base)
    declared = estimate_time(msgspec.structs.replace(base, play=plays(2, 5, 10)))
    assert 100 <= declared.seconds - without.seconds <= 110
    assert declared.at_most_s == declared.seconds
    more = estimate_time(msgspec.structs.replace(base, play=plays(2, 5, 10, most=20)))
    assert more.seconds == declared.seconds
    assert more.at_most_s - more.seconds == pytest.approx(300, abs=10)


def test_a_confirmation_and_a_budget_bound_the_longest_time() -> None:
    base = msgspec.structs.replace(plan(), play=plays(1, 10, 10), search=None)
    once = estimate_time(msgspec.structs.replace(base, gate=GatePlan(confirm=False)))
    twice = estimate_time(msgspec.structs.replace(base, gate=GatePlan(confirm=True)))
    assert twice.seconds == once.seconds
    assert twice.at_most_s > once.at_most_s + 100
    budget = GatePlan(confirm=True, time_budget_ns=130_000_000_000)
    limited = estimate_time(msgspec.structs.replace(base, gate=budget))
    assert once.at_most_s < limited.at_most_s < twice.at_most_s


def test_every_start_takes_time() -> None:
    base = msgspec.structs.replace(plan(), play=plays(1, 10, 2), search=None)
    one, five = (estimate_time(msgspec.structs.replace(base, starts=starts)) for starts in (1, 5))
    later_s = (five.seconds - one.seconds) / 4
    assert later_s > base.warm_up.seconds
    assert later_s < one.seconds - one.phases["play"]
    assert five.at_most_s - one.at_most_s == pytest.approx(2 * 4 * later_s)


def test_a_search_takes_its_probes_and_its_whole_plays_at_most() -> None:
    base = msgspec.structs.replace(plan(), play=(), sustained_hz=(), gate=GatePlan(confirm=False))
    without = estimate_time(msgspec.structs.replace(base, search=None))

    def added(probe_s: int, confirm_s: int) -> tuple[float, float]:
        search = SearchPlan(
            min_hz=10,
            max_hz=100,
            precision=0.02,
            probe_ns=probe_s * 10**9,
            holds=(),
            confirm_ns=confirm_s * 10**9,
        )
        found = estimate_time(msgspec.structs.replace(base, search=search))
        return found.seconds - without.seconds, found.at_most_s - without.at_most_s

    assert added(10, 30) == pytest.approx((105, 210))
    assert added(10, 0) == pytest.approx((60, 120))
    assert added(5, 10) == pytest.approx((45, 90))


def test_a_rate_that_must_be_sustained_is_played_whole() -> None:
    base = msgspec.structs.replace(plan(), search=None, sustained_hz=())
    asked = msgspec.structs.replace(base, sustained_hz=(10.0, 20.0))
    assert estimate_time(asked).seconds - estimate_time(base).seconds == pytest.approx(20)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.2, "1 s"),
        (8.1, "9 s"),
        (41, "45 s"),
        (90, "90 s"),
        (111, "115 s"),
        (116, "2 min"),
        (4800, "1 h 20 min"),
    ],
)
def test_times_are_written_for_people(seconds: float, text: str) -> None:
    assert time_text(seconds) == text


def test_the_deployments_that_can_be_tried_are_printed_and_nothing_is_started(
    call: Call, tmp_path: Path
) -> None:
    said = call("plan", RELAY, "--tune", "--set", "tune.limits.threads=2", status=0)
    assert "4 deployments, today's among them, of 2 levers" in said.out
    assert "graph.nodes.relay.threads: single-threaded | 2 threads\n" in said.out
    assert "\n  cpus: " in said.out.partition("Left out:")[2]
    file = tmp_path / "relay.json"
    call("plan", RELAY, "-o", file, status=0)
    assert "is a plan, whose deployment is fixed" in call("plan", file, "--tune", status=2).err
