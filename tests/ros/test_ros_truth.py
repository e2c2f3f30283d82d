"""Promise: what a graph cannot have done is not reported, and what is unknown is said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

import untruthful_nodes
from ros_runs import IMAGE, Bench, Finished, quick_input, relay_spec
from ros_runs import nothing_left as nothing_left

LEFT_MS = [33 * number for number in range(60)]
RIGHT_MS = [stamp + 3 * (number >= 3) for number, stamp in enumerate(LEFT_MS[:56])]
"""Two cameras that are not synchronised: three stamps are equal."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("truth"))
    source = Path(untruthful_nodes.__file__).read_text()
    (found.folder / "untruthful_nodes.py").write_text(source)
    return found


def run(
    bench: Bench,
    node: str,
    *required: str,
    match: str = "stamp",
    parameters: dict[str, Any] | None = None,
    **benchmark: Any,
) -> Finished:
    """Two iterations of two seconds at 20 Hz, without a confirmation run."""
    spec = relay_spec(
        graph={
            "nodes": {
                "node": {
                    "python": f"./untruthful_nodes.py:{node}",
                    "parameters": parameters or {},
                }
            }
        },
        monitors={"out": {"topic": "output", "format": IMAGE, "match": match}},
        slos={"all": {"at": "20 Hz", "require": list(required)}},
    )
    spec["benchmark"] |= {
        "duration": "2 s",
        "iterations": 2,
        "gate": {"confirm": False, "interference": "tolerate"},
    }
    spec["benchmark"] |= benchmark
    done = bench.run(spec)
    assert done.run().record.status == "complete", done.stderr
    return done


def seen(done: Finished) -> Any:
    """The pooled metrics of the monitor."""
    (rate,) = done.result()["metrics"]["rates"]
    return rate["pooled"]["monitors"]["out"]


def requirement(done: Finished, text: str) -> Any:
    (found,) = (
        each for each in done.result()["verdict"]["requirements"] if each["text"].startswith(text)
    )
    return found


def test_bursts_with_losses_do_not_have_more_throughput_than_what_came_out(bench: Bench) -> None:
    done = run(bench, "BatchesLossy", "throughput.mean >= 95 % of offered", duration="4 s")
    found = seen(done)
    assert found["sent"] == 160
    assert found["missed"] > 0
    assert 0 < found["throughput_hz"] <= 20 * found["answered"] / found["sent"] * (1 + 1e-9)
    assert requirement(done, "throughput.mean")["outcome"] != "pass"
    assert done.outcome != "pass"


def test_a_node_that_stops_once_and_answers_everything_lost_nothing(bench: Bench) -> None:
    done = run(bench, "StopsOnce", "drop_rate <= 10 %", duration="3 s")
    found = seen(done)
    assert (found["sent"], found["missed"], found["overdue"]) == (120, 0, 0)
    # It slept for so long: no machine is faster.
    assert found["latency"]["max"] > 1.0
    assert done.result()["output_gaps"] == []
    assert requirement(done, "drop_rate")["outcome"] == "pass" or done.outcome == "invalid"
    assert "0 of 120 steps" in requirement(done, "drop_rate")["reason"] or done.outcome == "invalid"


def test_by_order_a_node_that_drops_half_and_doubles_the_rest_is_invalid(bench: Bench) -> None:
    done = run(bench, "DropsAndDoubles", "drop_rate <= 10 %", "latency.p50 < 1 s", match="order")
    assert done.status == 4
    assert done.outcome == "invalid"
    reason = done.result()["verdict"]["reason"]
    assert "were received before their input was published, which is impossible" in reason
    assert reason in done.stdout.replace("\n", " ") or "impossible" in done.stdout


def test_by_order_more_outputs_than_the_ratio_allows_are_invalid(bench: Bench) -> None:
    done = run(bench, "Doubles", "drop_rate <= 10 %", match="order")
    assert (done.status, done.outcome) == (4, "invalid")
    assert "its ratio allows 80" in done.result()["verdict"]["reason"]


def test_by_order_the_latency_of_a_node_that_drops_is_unknown(bench: Bench) -> None:
    required = "latency.p50 < 1 s", "drop_rate <= 50 %"
    done = run(bench, "DropsSome", *required, match="order", drain_timeout="500 ms")
    found = seen(done)
    assert found["missed"] > 0
    assert found["latency"]["p50"] is None
    assert "matched by order" in found["unknown_latency"]
    latency = requirement(done, "latency.p50")
    assert latency["outcome"] == "inconclusive"
    if done.outcome != "invalid":
        assert "Match by stamp" in latency["remedy"]
        assert any("cancel out" in each for each in requirement(done, "drop_rate")["notes"])
    assert "the latency is unknown" in " ".join(done.stdout.split())


def test_a_node_that_restamps_is_named_as_such(bench: Bench) -> None:
    done = run(bench, "Restamps", "latency.p50 < 1 s", drain_timeout="500 ms")
    found = seen(done)
    assert found["received"] > 0
    assert (found["answered"], found["missed"]) == (0, found["sent"])
    assert found["throughput_hz"] == 0
    assert done.outcome in {"fail", "invalid"}
    if done.outcome == "fail":
        assert "none has the stamp of an input" in requirement(done, "latency")["reason"]


def test_a_node_that_is_constantly_4_s_late_loses_nothing_and_has_its_rate(bench: Bench) -> None:
    required = "drop_rate <= 10 %", "latency.p50 < 1 s", "throughput.mean >= 50 % of offered"
    done = run(bench, "SecondsLate", *required, drain_timeout="20 s")
    found = seen(done)
    assert (found["sent"], found["missed"]) == (80, 0)
    assert found["latency"]["min"] > 3.9, "it waits for so long"
    assert done.outcome in {"fail", "invalid"}
    if done.outcome == "fail":
        outcomes = [requirement(done, text.split()[0])["outcome"] for text in required]
        assert outcomes == ["pass", "fail", "pass"]


def test_answers_that_come_after_the_drain_timeout_are_counted_as_late(bench: Bench) -> None:
    done = run(
        bench,
        "SecondsLate",
        "drop_rate <= 10 %",
        parameters={"delay_s": 3.0},
        drain_timeout="500 ms",
        duration="2 s",
        iterations=3,
    )
    found = seen(done)
    late = sum(each["late"] for each in done.result()["output_gaps"])
    assert found["missed"] > 0
    assert found["overdue"] + late > 0
    text = " ".join(done.stdout.split())
    assert "late, not lost" in text or "arrived in a later segment" in text
    assert "none has the stamp of an input" not in text


@pytest.fixture(scope="module")
def stereo(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("stereo"), {"/left": LEFT_MS, "/right": RIGHT_MS})


def stereo_spec(**playback: Any) -> dict[str, Any]:
    return relay_spec(
        data_loader={"bag": "./bag", "topics": {"/left": "kept/left", "/right": "kept/right"}},
        playback={"inputs": {"left": quick_input("kept/left"), "right": quick_input("kept/right")}}
        | playback,
        graph={
            "nodes": {
                side: {
                    "python": "r2bspec.nodes.RelayNode",
                    "parameters": {"format": IMAGE, "service_time_ms": 1.0},
                    "remappings": {"input": side, "output": f"{side}_out"},
                }
                for side in ("left", "right")
            }
        },
        monitors={"out": {"topic": "left_out", "format": IMAGE}},
        slos={"all": {"at": "20 Hz", "require": ["latency.p50 < 10 s"]}},
    )


RIGHT = "53 of 56 messages of /r2b/right have no partner of the same stamp"
LEFT = "57 of 60 messages of /r2b/left have no partner of the same stamp"


def test_a_stereo_pair_without_equal_stamps_is_refused(stereo: Bench) -> None:
    done = stereo.run(stereo_spec())
    assert done.status == 2
    assert RIGHT in done.stderr
    assert LEFT in done.stderr
    assert "R2B415" in done.stderr


def test_a_spec_that_agrees_runs_and_every_report_says_what_was_not_played(stereo: Bench) -> None:
    spec = stereo_spec(unpaired="drop")
    names = ("markdown", "html", "junit", "github")
    reports = [f"--report={name}={stereo.folder}/report.{name}" for name in names]
    done = stereo.run(spec, *reports)
    found = {each.topic: each for each in done.run().record.unplayed}
    assert {name: (each.count, each.total) for name, each in found.items()} == {
        "/r2b/left": (57, 60),
        "/r2b/right": (53, 56),
    }
    assert RIGHT in " ".join(done.stdout.split())
    assert [each["count"] for each in done.result()["unplayed"]] == [57, 53]
    for name in names:
        assert RIGHT in (stereo.folder / f"report.{name}").read_text()


def test_a_plan_that_refuses_says_the_same_at_the_start_of_the_run(stereo: Bench) -> None:
    agreed = stereo.run(stereo_spec(unpaired="drop"), output=stereo.folder / "agreed")
    plan = json.loads((agreed.folder / "plan.json").read_text())
    refusing = stereo.folder / "refusing.json"
    refusing.write_text(json.dumps(plan | {"unpaired": "refuse"}))
    done = stereo.run(refusing)
    assert done.status == 2
    assert "R2B415" in done.error
    assert RIGHT in " ".join(done.error.split())
    assert "unpaired: drop" in " ".join(done.error.split())
