"""Documents and entries that build on others, the matrix, and declared variables."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.language.load_spec import load_cases, load_spec
from r2bspec.language.matrix import merge_case_findings
from r2bspec.language.spec import BagSource, ParameterSource, Spec

# Documents that build on files, and entries that build on siblings.


EXTENDING = Path(__file__).parents[2] / "golden" / "language" / "extending"
BASE = (EXTENDING / "parts" / "base.yaml").read_text()


def spec_of(file: Path, **options: object) -> Spec:
    loaded = load_spec(file, **options)  # type: ignore[arg-type]
    assert loaded.spec is not None, loaded.diagnostics
    return loaded.spec


def codes(file: Path, **options: object) -> list[str]:
    return [diagnostic.code for diagnostic in load_spec(file, **options).diagnostics]  # type: ignore[arg-type]


def test_maps_are_merged_lists_replaced_and_null_removes() -> None:
    spec = spec_of(EXTENDING / "ok_derived.r2b.yaml")
    assert spec.name == "derived"
    assert [str(rate) for rate in spec.benchmark.rates] == ["20 Hz"]
    assert (spec.benchmark.iterations, str(spec.data_loader.window.end)) == (3, "1 s")
    assert list(spec.graph.nodes) == ["relay"]
    assert spec.graph.nodes["relay"].remappings == {"input": "image", "output": "relayed"}


def test_paths_stay_relative_to_the_file_in_which_they_are_written() -> None:
    spec = spec_of(EXTENDING / "ok_derived.r2b.yaml")
    assert spec.data_loader.bag == BagSource(path="./parts/bags/kitchen")
    relay = spec.graph.nodes["relay"]
    assert relay.python == "./parts/nodes.py:Relay"
    assert relay.parameter_sources == (
        ParameterSource(file="./parts/relay.yaml"),
        ParameterSource(values={"depth": 3}),
    )
    assert relay.parameter_files == ("./parts/relay.yaml",)


def test_files_of_the_work_tree_are_extended_and_those_of_git_are_not(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    (tmp_path / "base.yaml").write_text(BASE)
    file = tmp_path / "inside" / "a.r2b.yaml"
    file.write_text("extends: ../base.yaml\n")
    assert codes(file) == ["R2B134"]
    assert codes(file, allow_paths=[tmp_path]) == []
    (tmp_path / ".git").mkdir()
    assert codes(file) == []
    (tmp_path / "base.yaml").rename(tmp_path / ".git" / "base.yaml")
    file.write_text("extends: ../.git/base.yaml\n")
    assert codes(file) == ["R2B134"]


def test_a_link_does_not_lead_outside(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    (tmp_path / "base.yaml").write_text(BASE)
    (tmp_path / "inside" / "link.yaml").symlink_to(tmp_path / "base.yaml")
    file = tmp_path / "inside" / "a.r2b.yaml"
    file.write_text("extends: link.yaml\n")
    assert codes(file) == ["R2B134"]


def test_long_chains_end(tmp_path: Path) -> None:
    for number in range(40):
        (tmp_path / f"{number}.yaml").write_text(f"extends: {number + 1}.yaml\n")
    assert codes(tmp_path / "0.yaml") == ["R2B135"]


# Declared variables, the matrix with its cases, and repeated entries.


BODY = """
data_loader: {bag: a, topics: {/a: b}}
playback: {inputs: {image: {from: b, format: sensor_msgs/msg/Image}}}
graph: {nodes: {relay: {python: my.Node, parameters: {threads: $(var threads)}}}}
monitors: {output: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [$(var rate)]}
"""
HEAD = "r2bspec: 1\nname: some\nvariables: {threads: 1, rate: 10 Hz}\n"
MATRIX = (
    "matrix:\n  axes: {threads: [1, 2, 4], rate: [10 Hz, 30 Hz]}\n"
    "  exclude: [{threads: 4, rate: 30 Hz}, {threads: 2}]\n  cases: {odd: {rate: 17 Hz}}\n"
)


def test_cases_are_called_by_their_values() -> None:
    cases = load_cases(HEAD + MATRIX + BODY)
    assert [case.id for case in cases] == [
        "some[threads=1,rate=10 Hz]",
        "some[threads=1,rate=30 Hz]",
        "some[threads=4,rate=10 Hz]",
        "some[odd]",
    ]
    threads = [case.spec.graph.nodes["relay"].parameters["threads"] for case in cases if case.spec]
    assert threads == [1, 1, 4, 1]


@pytest.mark.parametrize("name", ["odd", "some[odd]"])
def test_one_case_is_chosen_by_its_name(name: str) -> None:
    loaded = load_spec(HEAD + MATRIX + BODY, case=name)
    assert loaded.spec is not None
    assert [str(rate) for rate in loaded.spec.benchmark.rates] == ["17 Hz"]
    assert "matrix" not in loaded.resolved_yaml()
    assert load_spec(loaded.resolved_yaml()).spec == loaded.spec


def test_a_case_must_be_chosen_where_there_are_several() -> None:
    assert [diagnostic.code for diagnostic in load_spec(HEAD + MATRIX + BODY).diagnostics] == [
        "R2B140"
    ]
    for text in (HEAD + MATRIX + BODY, HEAD + BODY):
        assert [diagnostic.code for diagnostic in load_spec(text, case="ood").diagnostics] == [
            "R2B140"
        ]


def test_no_exclusion_is_left_out_without_a_word() -> None:
    many = ", ".join("{threads: 2}" for _ in range(1_001))
    matrix = f"matrix:\n  axes: {{threads: [1, 2]}}\n  exclude: [{many}]\n"
    (case,) = load_cases(HEAD + matrix + BODY)
    (finding,) = case.diagnostics
    assert (finding.code, finding.message) == (
        "R2B139",
        "the matrix has 1,001 exclusions; the limit is 1,000",
    )


def test_what_an_axis_gives_cannot_be_given_by_an_option() -> None:
    found = load_cases(HEAD + MATRIX + BODY, variables={"threads": 3})[0].diagnostics
    assert [one.code for one in found] == ["R2B128"]
    cases = load_cases(HEAD + MATRIX + BODY, sets=["matrix.axes.threads=[4]"])
    assert [case.case for case in cases] == ["threads=4,rate=10 Hz", "odd"]


def test_a_finding_of_all_cases_is_told_once() -> None:
    cases = load_cases(HEAD + MATRIX + BODY + "titel: a\n")
    (found,) = merge_case_findings(cases, [case.diagnostics for case in cases])
    assert (found.code, found.related) == ("R2B101", ())


def test_a_finding_of_some_cases_names_them() -> None:
    cases = load_cases(HEAD + MATRIX.replace("17 Hz", "17 s") + BODY)
    (found,) = merge_case_findings(cases, [case.diagnostics for case in cases])
    assert [each.message for each in found.related] == [
        "'rate' is set here",
        "in the case odd",
    ]


def test_declared_variables_have_their_types() -> None:
    head = (
        "r2bspec: 1\nname: some\nvariables:\n"
        "  threads: {type: string, value: '1'}\n"
        "  rate: {type: rate, default: 10 Hz}\n"
    )
    spec = load_spec(head + BODY).spec
    assert spec is not None
    assert spec.variables == {"threads": "1", "rate": "10 Hz"}
    spec = load_spec(head + BODY, variables={"threads": "010", "rate": "30 Hz"}).spec
    assert spec is not None
    assert spec.variables == {"threads": "010", "rate": "30 Hz"}
    (found,) = load_spec(head + BODY, variables={"rate": "20 s"}).diagnostics
    assert (found.code, found.span.file) == ("R2B130", "--var rate")


def test_a_variable_without_a_value_gets_one_from_an_option() -> None:
    text = HEAD.replace("threads: 1", "threads: {type: integer}") + BODY
    assert [diagnostic.code for diagnostic in load_spec(text).diagnostics] == ["R2B132"]
    assert load_spec(text, variables={"threads": "3"}).spec is not None


# ---- where a value came from -----------------------------------------------------------------
