"""Promise: what a graph cannot have done is not reported, and what is unknown is said."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")

import untruthful_nodes
from nightly import only_nightly
from ros_runs import IMAGE, Bench, Finished, quick_input, relay_node, relay_spec

STEPS = 80
"""Two iterations of two seconds at 20 Hz."""


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    found = Bench(tmp_path_factory.mktemp("truth"))
    source = Path(untruthful_nodes.__file__).read_text()
    (found.folder / "untruthful_nodes.py").write_text(source)
    return found


def run(
    bench: Bench,
    required: dict[str, tuple[str, ...]],
    by_order: str,
    drain: str,
) -> Finished:
    """A run of nodes of these kinds, each with a monitor of its name and its requirements."""
    spec = relay_spec(
        graph={
            "nodes": {
                kind: {
                    "python": f"./untruthful_nodes.py:{kind}",
                    "remappings": {"output": f"out/{kind}"},
                }
                for kind in required
            }
        },
        monitors={
            kind: {
                "topic": f"out/{kind}",
                "format": IMAGE,
                "match": "order" if kind in by_order.split() else "stamp",
            }
            for kind in required
        },
        slos={
            "all": {
                "at": "20 Hz",
                "require": [f"{kind}.{text}" for kind, texts in required.items() for text in texts],
            }
        },
    )
    spec["benchmark"] |= {"duration": "2 s", "iterations": 2, "drain_timeout": drain}
    spec["benchmark"]["gate"] = {"confirm": False, "interference": "tolerate"}
    done = bench.run(spec)
    assert done.run().record.status == "complete", done.stderr
    return done


# What arrives in the end, however late


@pytest.fixture(scope="module")
def awaited(bench: Bench) -> Finished:
    required = {
        "BatchesLossy": ("throughput.mean >= 95 % of offered",),
        "StopsOnce": ("drop_rate <= 10 %",),
        "SecondsLate": (
            "drop_rate <= 10 %",
            "latency.p50 < 1 s",
            "throughput.mean >= 50 % of offered",
        ),
    }
    return run(bench, required, "", "60 s")


def test_bursts_with_losses_do_not_have_more_throughput_than_what_came_out(
    awaited: Finished,
) -> None:
    found = awaited.monitor("BatchesLossy")
    assert found["sent"] == STEPS
    assert found["missed"] > 0
    assert 0 < found["throughput.mean"] <= 20 * found["answered"] / found["sent"] * (1 + 1e-9)
    assert awaited.requirement("BatchesLossy.throughput")["outcome"] != "pass"
    assert awaited.outcome != "pass"


def test_a_node_that_stops_once_and_answers_everything_lost_nothing(awaited: Finished) -> None:
    found = awaited.monitor("StopsOnce")
    assert (found["sent"], found["missed"], found["overdue"]) == (STEPS, 0, 0)
    # It slept for so long: no machine is faster.
    assert found["latency"]["max"] > 1.0
    assert not [gap for gap in awaited.result()["output_gaps"] if "StopsOnce" in gap["topic"]]
    if awaited.outcome != "invalid":
        requirement = awaited.requirement("StopsOnce.drop_rate")
        assert requirement["outcome"] == "pass"
        assert f"0 of {STEPS} steps" in requirement["reason"]


def test_a_node_that_is_constantly_late_loses_nothing_and_has_its_rate(awaited: Finished) -> None:
    found = awaited.monitor("SecondsLate")
    assert (found["sent"], found["missed"]) == (STEPS, 0)
    assert found["latency"]["min"] > 2.9, "it waits for so long"
    if awaited.outcome != "invalid":
        assert [
            awaited.requirement(f"SecondsLate.{metric}")["outcome"]
            for metric in ("drop_rate", "latency", "throughput")
        ] == ["pass", "fail", "pass"]


def test_messages_that_were_dropped_before_an_answer_are_not_waited_for(awaited: Finished) -> None:
    first, second = awaited.segments()
    # Not a rate: had the lost ones been waited for, it would have taken the whole minute.
    assert (second.began_ns - first.ended_ns) / 1e9 < 50


# What never arrives, or too late


@pytest.fixture(scope="module")
def given_up(bench: Bench) -> Finished:
    required = {
        "DropsSome": ("latency.p50 < 1 s", "drop_rate <= 50 %"),
        "Restamps": ("latency.p50 < 1 s",),
        "SecondsLate": ("drop_rate <= 10 %",),
    }
    return run(bench, required, "DropsSome", "500 ms")


def test_by_order_the_latency_of_a_node_that_drops_is_unknown(given_up: Finished) -> None:
    found = given_up.monitor("DropsSome")
    assert found["missed"] > 0
    assert found["latency"]["p50"] is None
    assert "matched by order" in found["unknown_latency"]
    latency = given_up.requirement("DropsSome.latency")
    assert latency["outcome"] == "inconclusive"
    if given_up.outcome != "invalid":
        assert "Match by stamp" in latency["remedy"]
        notes = given_up.requirement("DropsSome.drop_rate")["notes"]
        assert any("cancel out" in note for note in notes)
    assert "the latency is unknown" in given_up.words


def test_a_node_that_restamps_is_named_as_such(given_up: Finished) -> None:
    found = given_up.monitor("Restamps")
    assert found["received"] > 0
    assert (found["answered"], found["missed"]) == (0, found["sent"])
    assert found["throughput.mean"] == 0
    assert given_up.outcome in {"fail", "invalid"}
    if given_up.outcome == "fail":
        reason = given_up.requirement("Restamps.latency")["reason"]
        assert "none has the stamp of an input" in reason


def test_answers_that_come_after_the_drain_timeout_are_counted_as_late(given_up: Finished) -> None:
    found = given_up.monitor("SecondsLate")
    late = sum(
        gap["late"] for gap in given_up.result()["output_gaps"] if "SecondsLate" in gap["topic"]
    )
    assert found["missed"] > 0
    assert found["overdue"] + late > 0
    assert "late, not lost" in given_up.words or "arrived in a later segment" in given_up.words
    reason = given_up.requirement("SecondsLate.drop_rate")["reason"]
    assert "none has the stamp of an input" not in reason


# What is impossible


@only_nightly()
@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("DropsAndDoubles", "were received before their input was published, which is impossible"),
        ("Doubles", f"its ratio allows {STEPS}"),
    ],
)
def test_by_order_a_node_that_drops_half_and_doubles_the_rest_is_invalid(
    bench: Bench, kind: str, reason: str
) -> None:
    done = run(bench, {kind: ("drop_rate <= 10 %", "latency.p50 < 1 s")}, kind, "5 s")
    assert (done.status, done.outcome) == (4, "invalid")
    assert reason in done.result()["verdict"]["reason"]
    assert reason in done.words


# What is not played

LEFT_MS = [33 * number for number in range(60)]
RIGHT_MS = [stamp + 3 * (number >= 3) for number, stamp in enumerate(LEFT_MS[:56])]
"""Two cameras that are not synchronised: three stamps are equal."""


@pytest.fixture(scope="module")
def stereo(tmp_path_factory: pytest.TempPathFactory) -> Bench:
    return Bench(tmp_path_factory.mktemp("stereo"), {"/left": LEFT_MS, "/right": RIGHT_MS})


def stereo_spec(**playback: Any) -> dict[str, Any]:
    sides = ("left", "right")
    return relay_spec(
        data_loader={"bag": "./bag", "topics": {f"/{side}": f"kept/{side}" for side in sides}},
        playback={"inputs": {side: quick_input(f"kept/{side}") for side in sides}} | playback,
        graph={
            "nodes": {
                side: relay_node(remappings={"input": side, "output": f"{side}_out"})
                for side in sides
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
    for words in (RIGHT, LEFT, "R2B415"):
        assert words in done.stderr
    for way in ("pairing: {slop: ...}", "mode: timeline", "rate: recorded"):
        assert way in " ".join(done.stderr.split())


@only_nightly()
def test_a_spec_that_agrees_runs_and_every_report_says_what_was_not_played(stereo: Bench) -> None:
    names = ("markdown", "html", "junit", "github")
    reports = [f"--report={name}={stereo.folder}/report.{name}" for name in names]
    done = stereo.run(stereo_spec(unpaired="drop"), *reports)
    found = {each.topic: (each.count, each.total) for each in done.run().record.unplayed}
    assert found == {"/r2b/left": (57, 60), "/r2b/right": (53, 56)}
    assert RIGHT in done.words
    assert [each["count"] for each in done.result()["unplayed"]] == [57, 53]
    for name in names:
        assert RIGHT in (stereo.folder / f"report.{name}").read_text()
    # The plan of the run, which refuses: the run says the same as it starts.
    plan = json.loads((done.folder / "plan.json").read_text())
    refusing = stereo.folder / "refusing.json"
    refusing.write_text(json.dumps(plan | {"unpaired": "refuse"}))
    refused = stereo.run(refusing)
    assert refused.status == 2
    for words in ("R2B415", RIGHT, "unpaired: drop"):
        assert words in " ".join(refused.error.split())
