"""Documents that build on files, and entries that build on siblings."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.language.load_spec import load_spec
from r2bspec.language.spec import BagSource, ParameterSource, Spec

GOLDEN = Path(__file__).parents[2] / "golden" / "language" / "extending"
BASE = (GOLDEN / "parts" / "base.yaml").read_text()


def spec_of(file: Path, **options: object) -> Spec:
    loaded = load_spec(file, **options)  # type: ignore[arg-type]
    assert loaded.spec is not None, loaded.diagnostics
    return loaded.spec


def codes(file: Path, **options: object) -> list[str]:
    return [diagnostic.code for diagnostic in load_spec(file, **options).diagnostics]  # type: ignore[arg-type]


def test_maps_are_merged_lists_replaced_and_null_removes() -> None:
    spec = spec_of(GOLDEN / "ok_derived.r2b.yaml")
    assert spec.name == "derived"
    assert [str(rate) for rate in spec.benchmark.rates] == ["20 Hz"]
    assert (spec.benchmark.iterations, str(spec.data_loader.window.end)) == (3, "1 s")
    assert list(spec.graph.nodes) == ["relay", "twin"]
    assert spec.graph.nodes["twin"].remappings == {"input": "image", "output": "twin_out"}


def test_the_later_of_several_files_wins() -> None:
    spec = spec_of(GOLDEN / "ok_of_two.r2b.yaml")
    assert (spec.title, spec.benchmark.iterations) == ("The later one wins", 7)


def test_paths_stay_relative_to_the_file_in_which_they_are_written() -> None:
    spec = spec_of(GOLDEN / "ok_derived.r2b.yaml")
    assert spec.data_loader.bag == BagSource(path="./parts/bags/kitchen")
    relay = spec.graph.nodes["relay"]
    assert relay.python == "./parts/nodes.py:Relay"
    assert relay.parameter_sources == (
        ParameterSource(file="./parts/relay.yaml"),
        ParameterSource(values={"depth": 3}),
    )
    assert relay.parameter_files == ("./parts/relay.yaml",)


def test_options_come_after_files_and_before_variables() -> None:
    file = GOLDEN / "ok_of_two.r2b.yaml"
    spec = spec_of(file, sets=["benchmark.iterations=2"], variables={"rate": "15 Hz"})
    assert spec.benchmark.iterations == 2
    assert [str(rate) for rate in spec.benchmark.rates] == ["10 Hz", "15 Hz"]


def test_every_text_is_at_hand_for_carets() -> None:
    loaded = load_spec(GOLDEN / "ok_derived.r2b.yaml")
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
