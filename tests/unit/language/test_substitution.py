"""Variables, the environment, and options that replace values."""

from __future__ import annotations

from typing import Any

import pytest

from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import to_plain

SPEC = """\
r2bspec: 1
name: relay
environment: [WIDTH, EMPTY]
variables: {width: 1280, rate: 30 Hz, fine: true, half: 0.50, hexa: 0x10, topic: out}
labels: {x: $(var width)}
data_loader: {bag: r2b_storage, topics: {/image: image_raw}}
playback:
  inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}
graph:
  nodes:
    relay: {python: r2bspec.nodes.RelayNode, parameters: {p: 1}}
monitors: {output: {topic: out, format: sensor_msgs/msg/Image}}
benchmark: {rates: [10 Hz, 20 Hz]}
"""


def label(written: str, **environ: str) -> Any:
    loaded = load_spec(SPEC.replace("$(var width)", written), environ=environ)
    assert loaded.spec is not None, loaded.diagnostics
    return loaded.spec.labels["x"]


@pytest.mark.parametrize(
    ("written", "value"),
    [
        ("$(var width)", 1280),
        ('"$(var width)"', 1280),
        ("$( var  width )", 1280),
        ("$(var fine)", True),
        ("$(var half)", 0.5),
        ("w=$(var width)", "w=1280"),
        ("$(var half)/$(var hexa)", "0.50/0x10"),  # as it was written
        ("$(var fine) ", True),  # YAML drops the blank
        ("$(env WIDTH)", 640),
        ("$(env WIDTH) px", "640 px"),
        ("$(env EMPTY)", ""),
        ("a$b (var) $x", "a$b (var) $x"),
    ],
)
def test_values(written: str, value: object) -> None:
    found = label(written, WIDTH="640", EMPTY="")
    assert found == value
    assert type(found) is type(value)


def test_keys_of_topic_maps() -> None:
    loaded = load_spec(SPEC.replace("/image:", "/$(var topic)/raw:"), environ={})
    assert loaded.spec is not None
    assert loaded.spec.data_loader.topics == {"/out/raw": "image_raw"}


def test_variables_may_come_from_the_environment() -> None:
    content = SPEC.replace("width: 1280", "width: $(env WIDTH)")
    loaded = load_spec(content, environ={"WIDTH": "640"})
    assert loaded.spec is not None
    assert loaded.spec.variables["width"] == 640
    assert loaded.spec.labels["x"] == 640


def test_a_value_from_a_variable_shows_both_places() -> None:
    content = SPEC.replace("10 Hz,", "$(var width),")
    (found,) = load_spec(content, environ={}).diagnostics
    assert (found.code, found.span.line, found.span.column) == ("R2B109", 13, 21)
    assert [(one.span.line, one.span.column) for one in found.related] == [(4, 20)]
    assert found.edit is None, "others may rely on the variable"


# ---- --set and --var -------------------------------------------------------------------------


def plain(loaded: LoadedSpec) -> Any:
    assert loaded.spec is not None, loaded.diagnostics
    assert loaded.tree is not None
    return to_plain(loaded.tree)


@pytest.mark.parametrize(
    ("option", "path", "value"),
    [
        ("name=other", ("name",), "other"),
        ("benchmark.rates[1]=5 Hz", ("benchmark", "rates", 1), "5 Hz"),
        ("benchmark.rates=[1 Hz, 2 Hz]", ("benchmark", "rates"), ["1 Hz", "2 Hz"]),
        ("data_loader.topics./image=raw", ("data_loader", "topics", "/image"), "raw"),
        ("data_loader.topics['/image']=raw", ("data_loader", "topics", "/image"), "raw"),
        ("graph.nodes.relay.parameters.p=2.5", ("graph", "nodes", "relay", "parameters", "p"), 2.5),
        ("labels.x='5'", ("labels", "x"), "5"),
        ("labels.x=a=b: c # d", ("labels", "x"), "a=b: c # d"),
        ("labels.x=", ("labels", "x"), ""),
        ("labels.x=$(var fine)", ("labels", "x"), True),
        ("variables.width=7", ("labels", "x"), 7),
        # Keys of the language that the document does not have.
        ("benchmark.warm_up=2 s", ("benchmark", "warm_up"), "2 s"),
        ("transport=udp", ("transport",), "udp"),
        ("benchmark.gate.confidence=99 %", ("benchmark", "gate", "confidence"), "99 %"),
        ("monitors.output.match=order", ("monitors", "output", "match"), "order"),
        ("graph.nodes.relay.env.A=b", ("graph", "nodes", "relay", "env", "A"), "b"),
        ("graph.nodes.relay.parameters.q=3", ("graph", "nodes", "relay", "parameters", "q"), 3),
        ("labels.new=y", ("labels", "new"), "y"),
    ],
)
def test_set(option: str, path: tuple[str | int, ...], value: object) -> None:
    found = plain(load_spec(SPEC, sets=[option], environ={}))
    for part in path:
        found = found[part]
    assert found == value


@pytest.mark.parametrize(("given", "value"), [("7", 7), (7, 7), (True, True), ("x y", "x y")])
def test_var(given: Any, value: object) -> None:
    found = plain(load_spec(SPEC, variables={"width": given}, environ={}))
    assert found["labels"]["x"] == value


@pytest.mark.parametrize(
    ("sets", "variables", "code", "column", "help_part"),
    [
        (["benchmark.rate=1 Hz"], {}, "R2B127", 11, "did you mean 'rates'"),
        (["benchmark.wram_up=1 s"], {}, "R2B127", 11, "did you mean 'warm_up'"),
        (["benchmark.gate.confidenc=99 %"], {}, "R2B127", 16, "did you mean 'confidence'"),
        (["graph.nodes.rely.parameters.p=1"], {}, "R2B127", 13, "did you mean 'relay'"),
        (["benchmark.warm_up.x=1"], {}, "R2B127", 19, "keys of the language"),
        (["extends=other.r2b.yaml"], {}, "R2B127", 1, "known keys"),
        (["benchmark.rates[2]=1 Hz"], {}, "R2B127", 17, "2 items"),
        (["name.x=1"], {}, "R2B127", 6, "only values that the document has"),
        (["nonsense"], {}, "R2B127", 1, "--set benchmark.iterations=3"),
        (["=1"], {}, "R2B127", 1, "--set benchmark.iterations=3"),
        (["benchmark.rates=[1 Hz"], {}, "R2B012", 17, "']'"),
        (["benchmark.rates[0]=5"], {}, "R2B109", 20, "write 5 Hz"),
        ([], {"widht": "1"}, "R2B128", 1, "did you mean 'width'"),
        (["name=a\x00"], {}, "R2B003", 6, ""),
    ],
)
def test_wrong_options(
    sets: list[str], variables: dict[str, str], code: str, column: int, help_part: str
) -> None:
    (found,) = load_spec(SPEC, sets=sets, variables=variables, environ={}).diagnostics
    assert (found.code, found.span.line, found.span.column) == (code, 1, column)
    assert found.span.file.startswith("--")
    assert help_part in found.help
