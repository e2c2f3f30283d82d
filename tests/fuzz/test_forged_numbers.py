"""Promise: whatever number a forged run, plan, comparison or result has, it is judged or refused.

No number leads to an internal error, to a crash of a library, or to a report that its readers
cannot parse.
"""

from __future__ import annotations

import contextlib
import copy
import csv
import hashlib
import io
import json
import random
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hostile_calls import LONGEST_S

from nightly import size
from pair_simulation import Comparison
from r2bspec.compare.report_input import ReportInput, read_folder, read_report_input
from r2bspec.errors import R2bspecError
from r2bspec.judge.decision_policy import DecisionPolicy
from r2bspec.judge.judge_run import result_of, to_json
from r2bspec.judge.pipeline import judge
from r2bspec.record.run_folder import open_run
from r2bspec.report.format_registry import FORMATS, renderer
from report_runs import GraphSimulation, skewed, with_losses
from run_simulation import Played, objective
from simulated_runs import run_of

pytestmark = pytest.mark.timeout(10 * LONGEST_S)

NUMBERS = (-1, 0, 2**63 - 1, -(2**63), 2**31, 0.5, 5e-324, 1e30, -1e30)
PLACES = size(25, 10_000)
"""How many places of a document get each number."""
OTHERS: tuple[object, ...] = ("x", "", None, [], {})
"""What a fact of the machine may be, whose type is free."""


def run_folder(path: Path) -> Path:
    """A run whose record has a value in nearly every field."""
    GraphSimulation(
        segments=[
            Played(10, skewed(40, 0.02)),
            Played(10, with_losses(40, 0.03, 40, 9)),
            Played(10, skewed(40, 0.02), kind="probe"),
        ],
        objectives={"all": objective("latency.p90 < 60 ms", "drop_rate <= 1 %", at="10 Hz")},
        interference={"busy_s": 1.0, "stolen_s": 0.001, "waited_s": 0.04, "throttled_s": 0.0},
    ).write(path)
    file = path / "record.json"
    record = json.loads(file.read_text())
    first, second, probe = record["segments"]
    second["start"] = 2
    probe_record = {
        "segment": probe["id"],
        "rate_hz": 10.0,
        "delivered_hz": 9.9,
        "holds": True,
        "reason": "",
        "confidence": 0.95,
        "played_s": 4.0,
        "lost_at_most": 0.01,
        "taken": 0.1,
    }
    capacity = {"hz": 30.0, "lower_hz": 20.0, "upper_hz": 40.0, "played_s": 3.0}
    search = {
        "probes": [probe_record],
        "holds_hz": 10.0,
        "fails_hz": 20.0,
        "limited_by": "graph",
        "confidence": 0.95,
        "proof": "confirmed",
        "proof_s": 9.0,
        "lost_at_most": 0.01,
        "max_lost": 0.02,
        "unsteady_ratio": 1.5,
        "watched_s": 30.0,
        "capacity": capacity,
    }
    overhead = {
        "topic": "/r2b/image",
        "bytes": 9,
        "rate_hz": 30.0,
        "sent": 10,
        "received": 9,
        "latency_p50_ns": 1000,
        "latency_p99_ns": 2000,
        "lateness_p50_ns": 10,
        "lateness_p99_ns": 20,
        "processes": 2,
    }
    began_ns = first["began_ns"]
    starts = [
        {"number": number, "began_ns": began_ns - 10**9, "ready_ns": began_ns, "taken": 0.1}
        for number in (1, 2)
    ]
    record |= {
        "search": search,
        "harness_overhead": [overhead],
        "starts": starts,
        "unplayed": [{"topic": "/r2b/image", "count": 3, "total": 10, "slop_ns": 5}],
        "ended_rates": [{"rate_hz": 10.0, "iterations": 2}],
        "machine": record["machine"] | {"threads_per_core": 2, "memory_bytes": 10**9, "gpus": []},
    }
    file.write_text(json.dumps(record))
    return path


def number_places(value: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The way to each number of a document, and to each fact of the machine."""
    if isinstance(value, dict | list):
        items = value.items() if isinstance(value, dict) else enumerate(value)
        return [place for key, item in items for place in number_places(item, (*above, key))]
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return [above] if is_number or "machine" in above[:1] else []


def forged(document: Any, seed: str) -> Iterator[Any]:
    """The document with one of its numbers replaced."""
    rng = random.Random(seed)  # noqa: S311 - nothing is secret
    places = number_places(document)
    for place in rng.sample(places, min(PLACES, len(places))):
        values = NUMBERS + OTHERS if place[0] == "machine" else NUMBERS
        for value in rng.sample(values, size(3, len(values))):
            changed = inner = copy.deepcopy(document)
            for key in place[:-1]:
                inner = inner[key]
            inner[place[-1]] = value
            yield changed


def check_reports(found: ReportInput, names: Iterable[str]) -> None:
    """See that each report is made, or refused, and can be parsed."""
    for name in names:
        try:
            content = renderer(name)(found)
        except R2bspecError:
            continue
        check_parses(name, content)


def check_parses(name: str, content: bytes) -> None:
    """Read a report as its readers do."""
    match name:
        case "junit" | "junit_lenient":
            ET.fromstring(content)  # noqa: S314 - it is our own
        case "csv" | "samples":
            rows = list(csv.reader(io.StringIO(content.decode())))
            assert len({len(row) for row in rows}) <= 1
        case "openmetrics":
            parser = pytest.importorskip("prometheus_client.openmetrics.parser")
            list(parser.text_string_to_metric_families(content.decode()))
        case _ if not FORMATS[name].is_text and name != "mcap":
            # Python's own module reads NaN and Infinity, which are no JSON.
            json.loads(content, parse_constant=pytest.fail)


READERS = ("text", "junit", "csv", "openmetrics", "ros2_benchmark")
"""Of a folder: one of each kind, to keep the test short."""


@pytest.mark.parametrize("name", ["record.json", "plan.json"])
def test_a_number_of_a_run_folder_is_judged_or_refused(name: str, tmp_path: Path) -> None:
    folder = run_folder(tmp_path / "run")
    file, record_file = folder / name, folder / "record.json"
    original = json.loads(file.read_text())
    check_reports(read_folder(folder), FORMATS)
    for document in forged(original, name):
        text = json.dumps(document)
        if name == "plan.json":
            record = json.loads(record_file.read_text())
            record["plan_hash"] = f"sha256:{hashlib.sha256(text.encode()).hexdigest()}"
            record_file.write_text(json.dumps(record))
        file.write_text(text)
        with contextlib.suppress(R2bspecError):
            check_reports(read_folder(folder), READERS)


def test_a_number_of_a_comparison_is_judged_or_refused(tmp_path: Path) -> None:
    folder = tmp_path / "pairs"
    Comparison(base=[0.03] * 4, head=[0.031] * 4).write(folder)
    file = folder / "pairs.json"
    read_folder(folder)
    for document in forged(json.loads(file.read_text()), file.name):
        file.write_text(json.dumps(document))
        with contextlib.suppress(R2bspecError):
            check_reports(read_folder(folder), ["text"])


@pytest.mark.parametrize("name", [name for name in FORMATS if name not in {"html", "samples"}])
def test_every_report_of_a_forged_result_can_be_parsed(name: str, tmp_path: Path) -> None:
    run = open_run(run_folder(tmp_path / "run"))
    file = tmp_path / "result.json"
    for document in forged(json.loads(to_json(result_of(run))), name):
        file.write_text(json.dumps(document))
        with contextlib.suppress(R2bspecError):
            check_reports(read_report_input(file), [name])


@pytest.mark.parametrize("start", [1, 2**20, 2**62, 2**63 - 1])
def test_the_number_of_a_start_takes_no_memory(start: int) -> None:
    """NumPy makes as many counts as the largest number, and one more, which overflows."""
    latency = np.full((2, 400), 0.01)
    latency[:, 7] = np.nan
    run = run_of(latency, starts=(1, start))
    verdict = judge({"slo": objective("drop_rate <= 3 %")}, run, DecisionPolicy())
    assert verdict.outcome == "pass"
