"""Rules are run over a spec, and what follows from something already said is left out."""

from __future__ import annotations

from pathlib import Path

import pytest
from check_specs import codes, findings

from example_spec import example
from r2bspec.diagnostics import Severity
from r2bspec.language.load_spec import load_spec

ROOT = Path(__file__).parents[3]
MISSPELT = example(
    graph="nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: imgae}}}"
)


def test_a_wrong_topic_is_one_finding_at_the_wrong_word() -> None:
    (found,) = findings(MISSPELT)
    assert (found.code, found.severity) == ("R2B207", Severity.ERROR)
    line = MISSPELT.splitlines()[found.span.line - 1]
    assert line[found.span.column - 1 : found.span.end_column - 1] == "imgae"
    assert found.path == ("graph", "nodes", "relay", "remappings", "input")
    assert found.help == "did you mean 'image'?"


def test_independent_problems_are_all_told_in_the_order_of_the_document() -> None:
    text = example(
        variables="{unused: 1}",
        graph="nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: imgae}}}",
        benchmark="{rates: [30 Hz, 30 Hz]}",
        slos="{fast: {at: 60 Hz, require: [latency.p50 < 1 ms]}}",
    )
    assert codes(text) == ["R2B616", "R2B207", "R2B512", "R2B504"]


def test_a_document_with_errors_is_not_checked_further() -> None:
    found = findings(MISSPELT.replace("name: example", "nam: example"))
    assert {each.code[:4] for each in found} == {"R2B1"}


def test_warnings_of_the_document_are_kept() -> None:
    assert codes("\ufeff" + MISSPELT) == ["R2B004", "R2B207"]


def test_a_value_that_a_variable_brought_says_where_it_was_written() -> None:
    text = example(
        variables="{topic: imgae}",
        graph="nodes: {relay: {python: r2bspec.nodes.RelayNode,"
        " remappings: {input: $(var topic)}}}",
    )
    (found,) = findings(text)
    assert text.splitlines()[found.span.line - 1][found.span.column - 1 :].startswith("$(var")
    assert "'topic' is set here" in [each.message for each in found.related]


@pytest.mark.parametrize(
    ("written", "edit"), [("10", "10.0"), ("0x0a", "10.0"), ("'10'", None), ("$(var time)", None)]
)
def test_an_edit_is_offered_only_for_exactly_what_is_written(
    written: str, edit: str | None
) -> None:
    text = example(
        variables="{time: 10}",
        graph="nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image},"
        f" parameters: {{service_time_ms: {written}}}}}}}",
    )
    found = next(each for each in findings(text) if each.code == "R2B212")
    assert (found.edit.text if found.edit else None) == edit
    if found.edit is not None:
        assert found.edit.span == found.span


def test_a_finding_inside_a_text_has_its_column() -> None:
    text = example(slos="{fast: {at: 30 Hz, require: ['  latency.p90   < 5 Hz']}}")
    (found,) = findings(text)
    line = text.splitlines()[found.span.line - 1]
    assert line[found.span.column - 1 : found.span.end_column - 1] == "5 Hz"


def test_offline_nothing_is_said_about_data(tmp_path: Path) -> None:
    text = example(data_loader="{bag: ./nowhere, topics: {/camera: image_raw}}")
    file = str(tmp_path / "spec.r2b.yaml")
    assert codes(text, file=file) == ["R2B301"]
    assert codes(text, file=file, offline=True) == []


@pytest.mark.parametrize("file", sorted((ROOT / "specs").rglob("*.r2b.yaml")), ids=lambda f: f.stem)
def test_nothing_is_said_about_the_specs_that_are_shipped(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("R2B_DATASETS", raising=False)
    loaded = load_spec(file)
    from r2bspec.check import check

    # Packages of ROS that no wheel has may be missing here, and so may their messages.
    missing = [each for each in check(loaded) if each.code in {"R2B622", "R2B681"}]
    assert check(loaded) == missing
    assert all(each.certainty == "environment" for each in missing)
    first = loaded.texts[str(file)].splitlines()[0]
    assert first.startswith("# yaml-language-server: $schema=")
    assert (file.parent / first.partition("=")[2]).resolve().is_file()


def test_node_code_beside_the_spec_is_read_but_not_executed(tmp_path: Path) -> None:
    witness = tmp_path / "executed"
    (tmp_path / "nodes.py").write_text(
        f"open({str(witness)!r}, 'w')\nclass Detector: ...\n", encoding="utf-8"
    )
    text = example(
        graph="nodes: {a: {python: './nodes.py:Detector',"
        " subscribes: {image: sensor_msgs/msg/Image},"
        " publishes: {output: sensor_msgs/msg/Image}}}"
    )
    assert codes(text, file=str(tmp_path / "spec.r2b.yaml")) == []
    assert not witness.exists()
