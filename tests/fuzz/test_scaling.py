"""Promise: work is bounded by input. Twice the input takes at most 2.5 times the CPU.

Every family makes a large spec of one kind. Each is checked at two sizes, one twice the other, in
turns and several times; the least CPU of each counts, so that other programs of the machine have
no part in it. At these sizes a quadratic rule takes four times as long.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from nightly import only_nightly, size
from r2bspec.check.check_context import Context
from r2bspec.check.rules import bounds
from r2bspec.cli.check_files import CheckOptions, check_file

MAX_RATIO = 2.5
REPETITIONS = 3
MAX_REPETITIONS = 12
"""On a busy machine, caches are shared with others: more of them find the least CPU."""

DATA = "data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}}\n"
PLAYBACK = "playback: {inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}\n"
GRAPH = "graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode, remappings: {input: image}}}}\n"
MONITORS = "monitors: {output: {topic: output, format: sensor_msgs/msg/Image}}\n"
HEAD = "r2bspec: 1\nname: large\nbenchmark: {rates: [30 Hz]}\n"
NO_MONITORS = HEAD + DATA + PLAYBACK + GRAPH
NO_INPUTS = HEAD + DATA + MONITORS + GRAPH
REQUIRE = "slos:\n  fast:\n    at: 30 Hz\n    require:"
WITHOUT_GRAPH = HEAD + DATA + PLAYBACK + MONITORS
MINIMAL = WITHOUT_GRAPH + GRAPH

Family = Callable[[int], str]


def _lines(template: str, number: int) -> str:
    return "".join(template.replace("@", str(index)) + "\n" for index in range(number))


def _nodes(entry: str) -> Family:
    return lambda n: WITHOUT_GRAPH + "graph:\n  nodes:\n" + _lines(f"    n@: {{{entry}}}", n)


def _of_one_node(key: str, entry: str) -> Family:
    def text(n: int) -> str:
        entries = ", ".join(entry.replace("@", str(index)) for index in range(n))
        more = {"parameters": "remappings: {input: image}, ", "remappings": ""}[key]
        inner = f"{entries}, input: image" if key == "remappings" else entries
        return (
            WITHOUT_GRAPH + "graph: {nodes: {relay: {python: r2bspec.nodes.RelayNode, "
            f"{more}{key}: {{{inner}}}}}}}}}\n"
        )

    return text


def _section(head: str, template: str, base: str = MINIMAL) -> Family:
    template = template.replace("FORMAT", "format: sensor_msgs/msg/Image")
    return lambda n: base + head + "\n" + _lines(template, n)


def _matrix(n: int) -> str:
    nodes = _lines("    n@: {python: r2bspec.nodes.RelayNode, remappings: {input: $(var a)}}", 5)
    values = ", ".join(f"t{index}" for index in range(n))
    matrix = f"variables: {{a: image}}\nmatrix: {{axes: {{a: [{values}]}}}}\n"
    return WITHOUT_GRAPH + "graph:\n  nodes:\n" + nodes + matrix


def _exclusions(n: int) -> str:
    values = ", ".join(map(str, range(n)))
    rules = ", ".join(f"{{a: {index}}}" for index in range(1, n))
    return (
        MINIMAL + f"variables: {{a: 1}}\nmatrix: {{axes: {{a: [{values}]}}, exclude: [{rules}]}}\n"
    )


def _variables_in_use(n: int) -> str:
    variables = "variables:\n" + _lines("  v@: @", n)
    return MINIMAL + variables + "labels:\n" + _lines("  k@: $(var v@)", n)


RELAY = "python: r2bspec.nodes.RelayNode"

FAMILIES: dict[str, tuple[Family, int]] = {
    "nodes": (_nodes(f"{RELAY}, remappings: {{input: image, output: o@}}"), 500),
    "nodes in a chain": (_nodes(f"{RELAY}, remappings: {{input: o@, output: o1@}}"), 500),
    "nodes of which all publish one topic": (_nodes(RELAY), 1200),
    "nodes whose topics are unknown": (_nodes("package: none, executable: none"), 1200),
    "remappings": (_of_one_node("remappings", "r@: t@"), 2000),
    "remappings of one topic": (_of_one_node("remappings", "/r2b/x@: image"), 2000),
    "parameters": (_of_one_node("parameters", "p@: @"), 2000),
    "preprocessors": (
        _section("preprocessors:", f"  p@: {{{RELAY}, remappings: {{output: q@}}}}"),
        500,
    ),
    "inputs": (
        _section("playback:\n  inputs:", "    i@: {from: image_raw, FORMAT}", NO_INPUTS),
        1200,
    ),
    "monitors": (_section("monitors:", "  m@: {topic: o@, FORMAT}", NO_MONITORS), 1500),
    "monitors of one topic": (
        _section("monitors:", "  m@: {topic: output, FORMAT}", NO_MONITORS),
        1500,
    ),
    "equal requirements": (_section(REQUIRE, "    - latency.p90 < 50 ms"), 2500),
    "requirements": (_section(REQUIRE, "    - latency.p90 < 1@ ms"), 2500),
    "slos": (_section("slos:", "  s@: {at: 30 Hz, require: [latency.p90 < 50 ms]}"), 1200),
    "cases": (_matrix, 60),
    "named cases": (
        _section("variables: {a: 1}\nmatrix:\n  cases:", "    c@: {a: @}"),
        100,
    ),
    "exclusions": (_exclusions, 450),
    "variables": (_section("variables:", "  v@: @"), 2500),
    "variables in use": (_variables_in_use, 2500),
    "unknown variables": (_section("labels:", "  k@: $(var v@)"), 2500),
    "waivers": (_section("labels:", "  k@: 1 # r2bspec: ignore[R2B512] x"), 2500),
    "unclosed references": (lambda n: MINIMAL + f"title: '{'$(' * n}'\n", 200_000),
    "labels": (_section("labels:", "  k@: 1"), 5000),
    "unknown keys": (_section("", "k@: 1"), 2500),
    "duplicate keys": (_section("labels:", "  k: 1"), 5000),
    "topics": (
        _section(
            "data_loader:\n  bag: r2b_storage\n  topics:\n    /d455_1_rgb_image: image_raw",
            "    /t@: u@",
            HEAD + PLAYBACK + MONITORS + GRAPH,
        ),
        2000,
    ),
    "setup": (_section("setup:", "  s@: {command: [echo, x]}"), 1500),
    "ready": (_section("ready:", "  r@: {log: {process: relay, pattern: x@}}"), 1500),
    "environment": (_section("environment:", "- V@"), 2500),
}


def cpu_s(text: str, file: Path) -> float:
    """CPU of one check in this process."""
    file.write_text(text)
    gc.collect()
    started = time.process_time()
    check_file(str(file), CheckOptions(offline=True))
    return time.process_time() - started


def ratio(family: Family, size: int, file: Path) -> tuple[float, float]:
    """CPU of twice the input relative to that of the input, and the latter."""
    small, large = family(size), family(2 * size)
    pairs: list[tuple[float, float]] = []
    found, least = 0.0, 0.0
    while len(pairs) < REPETITIONS or (found > MAX_RATIO and len(pairs) < MAX_REPETITIONS):
        pairs.append((cpu_s(small, file), cpu_s(large, file)))
        least = min(one for one, _ in pairs)
        found = min(other for _, other in pairs) / least
    return found, least


@pytest.mark.timeout(120)
@pytest.mark.parametrize("name", list(FAMILIES)[:: size(4, 1)])
def test_twice_the_input_takes_about_twice_the_time(name: str, tmp_path: Path) -> None:
    family, number = FAMILIES[name]
    file = tmp_path / "large.r2b.yaml"
    cpu_s(family(10), file)  # imports
    measured, least = ratio(family, number, file)
    assert measured <= MAX_RATIO, f"{measured:.2f} times, from {least:.3f} s"


@only_nightly()
def test_what_is_quadratic_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def compare_with_all(context: Context, _: object) -> str:
        return str(sum(range(100 * len(context.requirements))))

    monkeypatch.setattr(bounds, "_applicability", compare_with_all)
    family, _ = FAMILIES["requirements"]
    measured, _ = ratio(family, 300, tmp_path / "large.r2b.yaml")
    assert measured > MAX_RATIO


LIMITS: dict[str, tuple[str, str, str]] = {
    "nodes": (_nodes(RELAY)(5001), "R2B129", "5,001 nodes; the limit is 5,000"),
    "monitors": (FAMILIES["monitors"][0](5001), "R2B129", "the limit is 5,000"),
    "requirements": (FAMILIES["requirements"][0](10_001), "R2B129", "the limit is 10,000"),
    "nodes x cases": (
        _nodes(RELAY)(500)
        + f"variables: {{a: 1}}\nmatrix: {{axes: {{a: [{', '.join(map(str, range(900)))}]}}}}\n",
        "R2B139",
        "the limit is 100,000",
    ),
    "exclusions": (
        _exclusions(1000).replace("exclude: [", "exclude: [{a: 1}, {a: 1}, "),
        "R2B139",
        "1,001 exclusions",
    ),
    "waivers": (MINIMAL + "# r2bspec: ignore[R2B512] x\n" * 350_000, "R2B002", "25,000 waivers"),
    "codes of one waiver": (
        MINIMAL + f"title: x # r2bspec: ignore[{'R2B512,' * 1_400_000}] x\n",
        "R2B002",
        "25,000 waivers",
    ),
    "findings of a rule": (
        FAMILIES["equal requirements"][0](2000),
        "R2B005",
        "more than 1,000 findings of R2B516",
    ),
}


@pytest.mark.parametrize("name", LIMITS)
def test_a_limit_is_an_answer_that_names_it(name: str, tmp_path: Path) -> None:
    text, code, said = LIMITS[name]
    file = tmp_path / "large.r2b.yaml"
    file.write_text(text)
    found = check_file(str(file), CheckOptions(offline=True)).findings
    named = [one for one in found if one.code == code and said in one.message]
    assert named
    assert len(found) <= 1010
