"""Every format, result.json among them: of every kind of run, the same bytes each time."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable
from dataclasses import replace

import msgspec
import pytest
from jsonschema import Draft202012Validator

from r2bspec.compare.report_input import ReportInput, SamplesMissingError
from r2bspec.judge.judge_run import from_json, result_of, to_json
from r2bspec.report.data_formats import result_schema
from r2bspec.report.format_registry import FORMATS, renderer
from report_runs import SIMULATIONS

# Every format: made from every kind of run, the same bytes each time, read by its readers.


Reported = Callable[[str], ReportInput]


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize("simulation", SIMULATIONS)
def test_every_run_gives_every_report(
    reported: Reported, html_page: Callable[[str], bytes], name: str, simulation: str
) -> None:
    source = reported(simulation)
    report = html_page(simulation) if name == "html" else renderer(name)(source)
    if name != "html" or simulation == "silent":  # a page of a whole run takes a second
        assert report == renderer(name)(replace(source))
    assert report.decode().endswith("\n")


@pytest.mark.parametrize("name", FORMATS)
def test_formats_that_need_samples_say_so_and_the_others_do_without(
    reported: Reported, name: str
) -> None:
    source = ReportInput(result=reported("usual").result)
    if name == "samples":
        with pytest.raises(SamplesMissingError, match="needs the samples"):
            renderer(name)(source)
    else:
        assert renderer(name)(source)


def test_csv_has_every_number(reported: Reported) -> None:
    source = reported("usual")
    rows = [*csv.DictReader(io.StringIO(renderer("csv")(source).decode(), newline=""))]
    found = {
        (row["offered_hz"], row["iteration"], row["monitor"], row["metric"]): float(row["value"])
        for row in rows
    }
    assert len(found) == len(rows)
    rate = source.result.metrics.rates[1]
    seen = rate.pooled.monitors["detections"]
    assert found["30.0", "", "detections", "latency.p99"] == seen.latency.p99
    assert found["30.0", "", "detections", "missed"] == seen.count("missed")
    first = rate.iterations[0].monitors["detections"].throughput_hz
    assert found["30.0", str(rate.iterations[0].index), "detections", "throughput.mean"] == first
    assert found["", "", "", "peak.rate"] == 5


def test_markdown_shows_hostile_words_as_words(reported: Reported) -> None:
    text = renderer("markdown")(reported("hostile")).decode()
    assert not re.search(r"<(script|img)", text)
    assert "\n::error" not in text
    assert "@all" not in text
    assert "http://" not in text
    titled = msgspec.structs.replace(reported("usual").result, title="/merge")
    assert "\n/" not in renderer("markdown")(ReportInput(result=titled)).decode()
    # Every row of a table has as many cells as its header.
    tables = re.findall(r"(?:^\|.*\|$\n?)+", text, re.MULTILINE)
    for table in tables:
        widths = {len(re.findall(r"(?<!\\)\|", row)) for row in table.strip().splitlines()}
        assert len(widths) == 1, table


@pytest.mark.usefixtures("without_charts")
@pytest.mark.parametrize("name", ["text", "markdown", "junit", "html", "github"])
def test_a_requirement_that_only_warns_is_told_as_one(reported: Reported, name: str) -> None:
    usual = reported("usual")
    result = usual.result
    warned = tuple(
        msgspec.structs.replace(
            requirement, level="warn", notes=("A look at half of it was open.",)
        )
        for requirement in result.verdict.requirements
    )
    verdict = msgspec.structs.replace(result.verdict, requirements=warned, outcome="pass")
    changed = msgspec.structs.replace(result, verdict=verdict)
    text = renderer(name)(replace(usual, result=changed)).decode()
    assert "A look at half of it was open." in text
    if name == "github":
        assert "::error" not in text
        assert "::warning" in text
    else:
        assert "✘ FAIL (warning)" in text
    if name == "junit":
        assert 'failures="0"' in text


def test_samples_are_every_expected_output(reported: Reported) -> None:
    source = reported("usual")
    rows = list(csv.DictReader(io.StringIO(renderer("samples")(source).decode())))
    for rate in source.result.metrics.rates:
        for monitor, seen in rate.pooled.monitors.items():
            of_rate = [
                row
                for row in rows
                if float(row["offered_hz"]) == rate.offered_hz
                and (row["monitor"], row["kind"]) == (monitor, "iteration")
            ]
            known = [int(row["latency_ns"]) for row in of_rate if row["latency_ns"]]
            assert (len(of_rate), len(of_rate) - len(known)) == (
                seen.expected,
                seen.count("missed"),
            )
            assert seen.latency.max == pytest.approx(max(known) / 1e9)
            assert all(
                int(row["received_ns"]) - int(row["published_ns"]) == int(row["latency_ns"])
                for row in of_rate
                if row["latency_ns"]
            )


# result.json: complete, valid by its schema, and the same bytes each time.


@pytest.mark.parametrize("name", SIMULATIONS)
def test_a_result_is_valid_by_the_schema_and_is_always_the_same(
    reported: Reported, name: str
) -> None:
    run, result = reported(name).run, reported(name).result
    content = to_json(result)
    Draft202012Validator(result_schema()).validate(json.loads(content))
    assert from_json(content) == result
    assert run is not None
    assert to_json(result_of(run)) == content
