"""Declared variables, the matrix with its cases, and repeated entries."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.language.load_spec import load_cases, load_spec
from r2bspec.language.matrix import merge_case_findings
from r2bspec.language.value_trace import UnknownPathError, provenance

GOLDEN = Path(__file__).parents[2] / "golden" / "language"
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


def test_without_a_matrix_there_is_one_case() -> None:
    (only,) = load_cases(HEAD + BODY)
    assert (only.id, only.case) == ("some", "")


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
        "  rate: {type: rate, default: 10 Hz, choices: [10 Hz, 30 Hz]}\n"
    )
    spec = load_spec(head + BODY).spec
    assert spec is not None
    assert spec.variables == {"threads": "1", "rate": "10 Hz"}
    spec = load_spec(head + BODY, variables={"threads": "010", "rate": "30 Hz"}).spec
    assert spec is not None
    assert spec.variables == {"threads": "010", "rate": "30 Hz"}
    for given, code in {"20 Hz": "R2B131", "20 s": "R2B130"}.items():
        found = load_spec(head + BODY, variables={"rate": given}).diagnostics
        assert [one.code for one in found] == [code]
        assert found[0].span.file == "--var rate"


def test_a_variable_without_a_value_gets_one_from_an_option() -> None:
    text = HEAD.replace("threads: 1", "threads: {type: integer}") + BODY
    assert [diagnostic.code for diagnostic in load_spec(text).diagnostics] == ["R2B132"]
    assert load_spec(text, variables={"threads": "3"}).spec is not None


def test_instances_have_variables_of_their_own() -> None:
    repeat = ", repeat: {l: {threads: 7, x: left}, r: {threads: 8, x: right}}, namespace: $(var x)"
    loaded = load_spec(HEAD + BODY.replace(": $(var threads)}", ": $(var threads)}" + repeat))
    assert loaded.spec is not None, loaded.diagnostics
    nodes = loaded.spec.graph.nodes
    assert {name: (n.namespace, n.parameters["threads"]) for name, n in nodes.items()} == {
        "relay_l": ("left", 7),
        "relay_r": ("right", 8),
    }
    assert loaded.used_variables == {"rate"}


@pytest.mark.timeout(30)
def test_repeating_is_bounded() -> None:
    instances = ", ".join(f"i{number}: {{}}" for number in range(2000))
    words = ", ".join(["a"] * 1000)
    node = f"{{command: [{words}], repeat: {{{instances}}}}}"
    found = load_spec(HEAD + BODY + f"preprocessors: {{many: {node}}}\n").diagnostics
    assert "R2B129" in {one.code for one in found}


# ---- where a value came from -----------------------------------------------------------------


def test_the_way_of_a_value() -> None:
    text = HEAD + MATRIX + BODY + "x-a: &a {bag: b}\ntitle: some\n"
    loaded = load_spec(text, file="some.yaml", case="odd", sets=["title=other"])
    said = {path: provenance(loaded, path).text() for path in ("benchmark.rates[0]", "title")}
    assert said["benchmark.rates[0]"] == (
        "benchmark.rates[0] = 17 Hz\n"
        "  some.yaml:13:21: written here, as $(var rate)\n"
        "  some.yaml:7:23: 'rate' is set here\n"
        "  some.yaml:7:11: in the case odd of the matrix\n"
    )
    assert said["title"] == "title = other\n  --set title:1:7: given by this option\n"
    assert provenance(loaded, "benchmark.warm_up").text() == (
        "benchmark.warm_up = 1 s\n  the default: the document does not set it\n"
    )


def test_the_way_through_files_siblings_and_aliases(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(GOLDEN / "extending")
    loaded = load_spec(Path("ok_derived.r2b.yaml"))
    assert provenance(loaded, "graph.nodes.twin.remappings.input").text() == (
        "graph.nodes.twin.remappings.input = image\n"
        "  parts/base.yaml:8:99: written here\n"
        "  ok_derived.r2b.yaml:7:21: 'twin' extends 'relay' here\n"
        "  ok_derived.r2b.yaml:1:10: 'parts/base.yaml' is extended here\n"
    )
    text = HEAD + BODY + "x-a: &a {A: b}\npreprocessors: {p: {command: [a], env: *a}}\n"
    assert provenance(load_spec(text), "preprocessors.p.env.A").text() == (
        "preprocessors.p.env.A = b\n"
        "  <text>:10:13: written here\n"
        "  <text>:11:35: an alias is the value of 'env' here\n"
    )


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("benchmark.durration", "'benchmark' has no 'durration'"),
        ("graph.nodes.other.env", "the document has no 'graph.nodes.other'"),
        ("=", "'=' is not a path"),
    ],
)
def test_paths_that_lead_nowhere(path: str, said: str) -> None:
    with pytest.raises(UnknownPathError, match=said.replace("'", "'")):
        provenance(load_spec(HEAD + BODY), path)
