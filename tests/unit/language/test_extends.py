"""Documents and entries that build on others, the matrix, and declared variables."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.language.load_spec import load_cases, load_spec
from r2bspec.language.matrix import merge_case_findings
from r2bspec.language.spec import BagSource, ParameterSource, Spec
from r2bspec.language.value_trace import UnknownPathError, provenance

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
    assert list(spec.graph.nodes) == ["relay", "twin"]
    assert spec.graph.nodes["twin"].remappings == {"input": "image", "output": "twin_out"}


def test_the_later_of_several_files_wins() -> None:
    spec = spec_of(EXTENDING / "ok_of_two.r2b.yaml")
    assert (spec.title, spec.benchmark.iterations) == ("The later one wins", 7)


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


def test_options_come_after_files_and_before_variables() -> None:
    file = EXTENDING / "ok_of_two.r2b.yaml"
    spec = spec_of(file, sets=["benchmark.iterations=2"], variables={"rate": "15 Hz"})
    assert spec.benchmark.iterations == 2
    assert [str(rate) for rate in spec.benchmark.rates] == ["10 Hz", "15 Hz"]


def test_every_text_is_at_hand_for_carets() -> None:
    loaded = load_spec(EXTENDING / "ok_derived.r2b.yaml")
    assert {Path(name).name for name in loaded.texts} == {"ok_derived.r2b.yaml", "base.yaml"}
    where = loaded.span(("benchmark", "iterations"))
    assert Path(where.file).name == "base.yaml"
    assert loaded.sources[where.file].line(where.line)[where.column - 1] == "3"


def test_a_folder_outside_must_be_allowed(tmp_path: Path) -> None:
    (tmp_path / "inside").mkdir()
    (tmp_path / "base.yaml").write_text(BASE)
    file = tmp_path / "inside" / "a.r2b.yaml"
    file.write_text("extends: ../base.yaml\n")
    assert codes(file) == ["R2B134"]
    assert codes(file, allow_paths=[tmp_path]) == []


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


@pytest.mark.timeout(20)
def test_many_ways_to_one_file_end(tmp_path: Path) -> None:
    for number in range(19):
        names = ", ".join([f"{number + 1}.yaml"] * 5)
        (tmp_path / f"{number}.yaml").write_text(f"extends: [{names}]\n")
    (tmp_path / "19.yaml").write_text(BASE)
    assert "R2B135" in codes(tmp_path / "0.yaml")


NODES = "r2bspec: 1\nname: a\ngraph:\n  nodes:\n"


@pytest.mark.timeout(20)
def test_long_chains_of_siblings_end() -> None:
    for order in (1, -1):
        entries = [f"    n{i}: {{extends: n{i + 1}}}\n" for i in range(2000)][::order]
        found = load_spec(NODES + "".join(entries) + "    n2000: {python: my.Node}\n")
        assert "R2B135" in {diagnostic.code for diagnostic in found.diagnostics}


def test_a_sibling_of_a_sibling() -> None:
    text = (
        "    c: {extends: b, env: null}\n"
        "    b: {extends: a, parameters: {y: 2}}\n"
        "    a: {python: my.Node, env: {A: b}, parameters: {x: 1}}\n"
    )
    loaded = load_spec(BASE.replace("  nodes:\n", "  nodes:\n" + text))
    assert loaded.spec is not None
    c = loaded.spec.graph.nodes["c"]
    assert (c.python, c.parameters, c.env) == ("my.Node", {"x": 1, "y": 2}, {})


# Declared variables, the matrix with its cases, and repeated entries.


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
