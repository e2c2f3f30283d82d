"""A patched spec says what ``--set`` says, and keeps every byte that is about something else."""

from __future__ import annotations

import difflib
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from nightly import size
from r2bspec.language.load_spec import load_cases
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.tune.patch import patch_spec

NODES = ["camera", "detector", "tracker"]
VALUES = {
    "cpus": ["[0]", "[1, 2]", "[]"],
    "nice": ["-5", "3"],
    "executor": ["multi_threaded", "single_threaded"],
    "threads": ["0", "4"],
    "env": ["{OMP_NUM_THREADS: 4}", "{}", '{A: "say: \\"1\\"", B: 010}'],
    "env.LANG": ["C", "1.50", "on", "a: b # c", "", "null", "ä\u2028é"],
    "scheduling": ["{policy: fifo, priority: 40}", "{memory_lock: true}"],
    "scheduling.policy": ["batch", "other"],
    "qos.output.depth": ["7", "100"],
    "parameters.rate": ["0.5", "1e-3", "[a, b]"],
}


INSIDE = {"env": {"LANG"}, "scheduling": {"policy", "priority"}}
"""Keys that a value has in block style, whose lines go with it."""


@st.composite
def written(draw: st.DrawFn, node: object, indent: int, step: int, *, flow: bool = False) -> str:
    """A value as people write it: in block or flow style, with comments, spaces and empty lines."""
    if not isinstance(node, dict):
        return str(node)
    if flow or not node or draw(st.booleans()):
        inner = [f"{key}: {draw(written(node[key], 0, step, flow=True))}" for key in node]
        return "{" + ", ".join(inner) + draw(st.sampled_from(["", " "])) + "}"
    lines = [""]
    for key in node:
        note = draw(st.sampled_from(["", "", "  # why", "\n" + " " * indent + "# below", "\n"]))
        value = draw(written(node[key], indent + step, step))
        space = "" if value.startswith("\n") else " "
        lines.append(f"{' ' * indent}{key}:{space}{value}{note if value else ''}")
    return "\n".join(lines)


@st.composite
def spec_texts(draw: st.DrawFn) -> str:
    keys = st.sampled_from(
        [
            ("cpus", "[0, 1]"), ("nice", "1"), ("threads", "$(var n)"), ("threads", "2"),
            ("env", {"LANG": "'C'"}), ("env", "*shared"), ("<<", "*common"), ("extends", "camera"),
            ("scheduling", {"policy": "rr", "priority": "9"}), ("qos", {"output": "sensor_data"}),
        ]
    )  # fmt: skip
    nodes = {
        name: {
            "python": f"my.{name.title()}",
            **dict(draw(st.lists(keys, max_size=4))),
        }
        for name in NODES
    }
    nodes["camera"].pop("extends", None)
    step = draw(st.sampled_from([2, 4]))
    blank = draw(st.sampled_from(["", "\n"]))
    head = (
        "r2bspec: 1\nname: some\nvariables: {n: 3}\n"
        "x-env: &shared {LANG: de}\nx-common: &common {nice: 2, cpus: [3]}\n"
    )
    loader = (
        "data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: image_raw}} # first\n"
        "playback: {inputs: {image: {from: image_raw, format: sensor_msgs/msg/Image}}}\n"
    )
    matrix = draw(st.sampled_from(["", "matrix: {axes: {n: [2, 3]}}\n"]))
    graph = draw(written({"nodes": nodes}, step, step))
    if not graph.startswith("\n"):
        graph = f" {graph}"
    end = draw(st.sampled_from(["", "\n", "\n\n# the end\n"]))
    tail = f"monitors: {{output: {{topic: output, format: sensor_msgs/msg/Image}}}}{end}"
    text = f"{head}{matrix}{blank}{loader}{blank}graph:{graph}\n{blank}{tail}"
    return text.replace("\n", draw(st.sampled_from(["\n", "\r\n"])))


ASSIGNMENTS = st.one_of(
    st.builds(
        lambda node, path, place: f"graph.nodes.{node}.{path}={VALUES[path][place % 2]}",
        st.sampled_from(NODES),
        st.sampled_from(list(VALUES)),
        st.integers(0, 9),
    ),
    st.sampled_from(
        [
            "containers={main: {executable: python, threads: 4}}",
            "graph.placement=shared",
            "benchmark.iterations=7",
            "title=a: 'quoted' title",
        ]
    ),
)


@settings(max_examples=size(60, 2000), deadline=None)
@given(spec_texts(), st.lists(ASSIGNMENTS, min_size=1, max_size=5))
def test_a_patched_spec_says_what_the_assignments_say(text: str, sets: list[str]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "some.r2b.yaml"
        file.write_bytes(text.encode())
        wanted = load_cases(file, sets=sets)
        if any(case.spec is None for case in wanted):
            return
        patch = patch_spec(SpecSelection(file), sets)
        patch.file.write_bytes(patch.after.encode())
        patched = load_cases(patch.file)
        assert [case.spec for case in patched] == [case.spec for case in wanted]
        if patch.file != file:
            assert file.read_bytes() == text.encode()
            assert "$(var" in text or "*" in text
            return
        # A file may end without a line break; with a key added below, it does not.
        newline = "\r\n" if "\r\n" in text else "\n"
        touched = {key for each in sets for key in each.partition("=")[0].split(".")}
        for key in [*touched]:
            touched |= INSIDE.get(key, set())
        for line in difflib.ndiff(text.split(newline), patch.after.split(newline)):
            if line.startswith("- "):
                assert any(f"{key}:" in line for key in (*touched, "extends")), line
            assert line.startswith("? ") or "\n" not in line
