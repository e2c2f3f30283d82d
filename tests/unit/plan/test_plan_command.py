"""``r2bspec plan``: what a run will do, and how long it takes."""

from __future__ import annotations

import json
import os
import stat
from pathlib import Path
from typing import Any

import msgspec
import pytest
from plan_specs import plan

from command_line import Call
from r2bspec.plan.canonical_json import read_plan
from r2bspec.plan.plan import GatePlan, PlayPlan, SearchPlan
from r2bspec.plan.time_estimate import BOTH_SIDES, TimeEstimate, estimate_time, estimate_turns
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
    call("plan", RELAY, "-o", link, "--graph", "mermaid", status=0)
    assert stat.S_ISCHR(link.stat().st_mode)


def test_the_spec_is_not_replaced_by_its_plan(tmp_path: Path, call: Call) -> None:
    spec = tmp_path / "a.r2b.yaml"
    spec.write_text(RELAY.read_text())
    (link := tmp_path / "link").symlink_to(spec)
    before = spec.read_bytes()
    assert "is an input" in call("plan", spec, "-o", link, status=2).err
    assert spec.read_bytes() == before


@pytest.mark.parametrize(
    ("form", "begins"),
    [("mermaid", "flowchart LR"), ("html", "<!DOCTYPE html>")],
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


# How long a run is expected to take.


BARE = msgspec.structs.replace(
    plan(), play=(), search=None, sustained_hz=(), gate=GatePlan(confirm=False), monitors=()
)


def plays(rates: int, seconds: int, iterations: int, most: int = 0) -> tuple[PlayPlan, ...]:
    play = PlayPlan(
        rate_hz=10.0, duration_ns=seconds * 10**9, iterations=iterations, max_iterations=most
    )
    return (play,) * rates


def search(probe_s: int, confirm_s: int) -> SearchPlan:
    probe_ns, confirm_ns = probe_s * 10**9, confirm_s * 10**9
    return SearchPlan(
        min_hz=10, max_hz=100, precision=0.02, probe_ns=probe_ns, holds=(), confirm_ns=confirm_ns
    )


@pytest.mark.parametrize(
    ("changes", "expected_s", "longest_s"),
    [
        ({"play": plays(2, 10, 5)}, 102, 102),
        ({"play": plays(2, 10, 5, most=20)}, 102, 408),
        # By order, a lost answer may let each drain take its 5 s.
        ({"play": plays(2, 10, 5), "monitors": plan().monitors}, 102, 152),
        # The confirmation of a failure starts everything once more.
        ({"play": plays(1, 10, 10), "gate": GatePlan()}, 102, 2 * 102 + 4.4),
        ({"play": plays(1, 10, 10), "gate": GatePlan(time_budget_ns=130 * 10**9)}, 102, 130),
        # Each of the later starts takes time, but less than the first.
        ({"play": plays(1, 2, 10), "starts": 5}, 22 + 4 * 4.1, 22 + 4 * 4.1),
        # A search ends when it can; its longest time is that of its probes and confirmations.
        ({"search": search(10, 30)}, 105, 210),
        ({"search": search(10, 0)}, 60, 120),
        ({"search": search(5, 10)}, 45, 90),
        # What must be sustained is played whole.
        ({"sustained_hz": (10.0, 20.0)}, 20, 20),
    ],
)
def test_what_a_plan_declares_takes_time(
    changes: dict[str, Any], expected_s: float, longest_s: float
) -> None:
    bare, found = estimate_time(BARE), estimate_time(msgspec.structs.replace(BARE, **changes))
    assert found.seconds - bare.seconds == pytest.approx(expected_s)
    assert found.at_most_s - bare.at_most_s == pytest.approx(longest_s)


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (TimeEstimate({"play": 41.0}, 41.0), "about 45 s"),
        (TimeEstimate({"play": 41.0}, 90.0), "about 45 s, up to 90 s"),
        (TimeEstimate({"play": 9.0}, 36.0, 4, 4), "about 40 s (4 runs)"),
        (
            TimeEstimate({"play": 9.0}, 180.0, 20, 10),
            "about 90 s to 3 min (10 to 20 runs)",
        ),
        (
            TimeEstimate({BOTH_SIDES: 9.0}, 166.0, 12, 5, "starts of both sides", 4.0),
            "about 50 s to 115 s (5 to 12 starts of both sides), up to 3 min with a confirmation",
        ),
    ],
)
def test_an_estimate_says_what_is_not_known(estimate: TimeEstimate, text: str) -> None:
    assert estimate.text() == text


def test_starts_of_both_sides_take_as_long_as_their_turns() -> None:
    plan = msgspec.structs.replace(BARE, play=plays(1, 10, 10))
    few, many = (estimate_turns(plan, 5, steps, base_alone=False) for steps in (40, 80))
    rate_hz = plan.play[0].rate_hz
    assert many.run_s - few.run_s == pytest.approx(40 / rate_hz)
    alone = estimate_turns(plan, 5, 40, base_alone=True)
    assert alone.run_s - few.run_s == pytest.approx(10.2)
    assert not few.is_open, "fewer than five starts decide nothing"
    assert estimate_turns(plan, 12, 40, base_alone=False).is_open
