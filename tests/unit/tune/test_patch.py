"""What the patch of a spec looks like; that it is right is tested in `tests/property/tune`."""

from __future__ import annotations

import shlex
import textwrap
from pathlib import Path

import pytest

from example_spec import example
from r2bspec.errors import UsageError
from r2bspec.language.load_spec import load_spec
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.tune.patch import Patch, patch_spec


def _patch(folder: Path, text: str, *sets: str) -> Patch:
    file = folder / "robot.r2b.yaml"
    file.write_bytes(text.encode())
    return patch_spec(SpecSelection(file), sets)


def _changed(patch: Patch) -> list[str]:
    """The lines that the patch removes and adds."""
    lines = patch.diff.splitlines()[2:]
    return [line for line in lines if line.startswith(("-", "+"))]


GRAPH = """
    # The nodes run on the second board.
    nodes:
      left:   # faces the dock
        python: my.Camera
        cpus:
          - 0   # shared with the driver
          - 1
        env: { LANG: 'C' }   # for the parser

      right: {extends: left, remappings: {image: right}}
"""


def test_values_are_replaced_and_keys_added_in_the_style_of_the_file(tmp_path: Path) -> None:
    patch = _patch(
        tmp_path,
        example(graph=GRAPH),
        "graph.nodes.left.cpus=[2, 3]",
        "graph.nodes.right.cpus=[2, 3]",
        "graph.nodes.left.env.OMP_NUM_THREADS=4",
        "graph.nodes.right.env.OMP_NUM_THREADS=4",
        "graph.nodes.right.executor=multi_threaded",
        "containers={main: {executable: python, threads: 2}}",
    )
    assert patch.file == tmp_path / "robot.r2b.yaml"
    assert _changed(patch) == [
        "+containers:",
        "+  main: {executable: python, threads: 2}",
        "-        - 0   # shared with the driver",
        "-        - 1",
        "-      env: { LANG: 'C' }   # for the parser",
        "+        - 2",
        "+        - 3",
        "+      env: { LANG: 'C', OMP_NUM_THREADS: 4 }   # for the parser",
        "-    right: {extends: left, remappings: {image: right}}",
        "+    right: {extends: left, remappings: {image: right}, executor: multi_threaded}",
    ]


def test_an_entry_that_extends_a_changed_one_keeps_its_own_value(tmp_path: Path) -> None:
    patch = _patch(
        tmp_path, example(graph=GRAPH), "graph.nodes.left.nice=5", "graph.nodes.left.cpus=[3]"
    )
    added = [line for line in _changed(patch) if line.startswith("+")]
    assert added[-1] == (
        "+    right: {extends: left, remappings: {image: right}, cpus: [0, 1], nice: null}"
    )


def test_a_file_that_extends_another_gets_the_keys_itself(tmp_path: Path) -> None:
    (tmp_path / "base.r2b.yaml").write_text(example(graph=GRAPH))
    patch = _patch(tmp_path, "extends: base.r2b.yaml\nname: here\n", "graph.nodes.left.nice=5")
    assert patch.after == textwrap.dedent("""\
        extends: base.r2b.yaml
        name: here
        graph:
          nodes:
            left: {nice: 5}
            right: {nice: null}
        """)


@pytest.mark.parametrize(
    ("value", "why"),
    [("$(var n)", "a variable has the value"), ("*shared", "an alias has the value")],
)
def test_a_second_file_where_a_value_belongs_to_several(
    tmp_path: Path, value: str, why: str
) -> None:
    text = example(
        graph=f"""
            nodes:
              left: {{python: my.A, threads: &shared 3}}
              right: {{python: my.B, threads: {value}}}
        """,
        variables="{n: 3}",
    )
    patch = _patch(tmp_path, text, "graph.nodes.right.threads=1")
    assert patch.file == tmp_path / "robot.tuned.r2b.yaml", why
    assert patch.before == ""
    assert patch.after.endswith(
        "extends: robot.r2b.yaml\ngraph:\n  nodes:\n    right: {threads: 1}\n"
    )
    assert patch.diff.startswith(f"--- a/{str(patch.file)[1:]}\n")
    patch.file.write_text(patch.after)
    spec = load_spec(patch.file).spec
    assert spec is not None
    assert (spec.graph.nodes["left"].threads, spec.graph.nodes["right"].threads) == (3, 1)


def test_byte_order_mark_and_line_ends_are_kept(tmp_path: Path) -> None:
    text = "\ufeff" + example().replace("\n", "\r\n")
    patch = _patch(tmp_path, text, "graph.nodes.relay.nice=3", "graph.placement=shared")
    assert patch.after.startswith("\ufeffr2bspec: 1\r\n")
    assert "  placement: shared\r\n" in patch.after
    assert patch.after.count("\n") == patch.after.count("\r\n")


def test_hostile_values_stay_values(tmp_path: Path) -> None:
    text = "graph.nodes.relay.env.X='it''s } # {{ \"x\" \\ *a'"
    patch = _patch(tmp_path, example(), text)
    spec = load_spec(patch.after).spec
    assert spec is not None
    assert spec.graph.nodes["relay"].env["X"] == 'it\'s } # {{ "x" \\ *a'


def test_all_cases_of_a_matrix_change(tmp_path: Path) -> None:
    text = example(matrix="{axes: {n: [1, 2]}}", variables="{n: 1}")
    patch = _patch(tmp_path, text, "graph.nodes.relay.nice=3")
    assert patch.notes == ("the change applies to all 2 cases of the matrix",)


def test_what_is_given_outside_of_the_file_stays_outside(tmp_path: Path) -> None:
    file = tmp_path / "robot.r2b.yaml"
    file.write_text(example())
    selection = SpecSelection(file, sets=["benchmark.iterations=3"])
    patch = patch_spec(selection, ["graph.nodes.relay.nice=3"])
    assert "iterations" not in patch.after
    assert "nice: 3" in patch.after
    assert patch.notes == (
        "proved with --set benchmark.iterations=3, which the change does not have",
    )
    selection = SpecSelection(file, variables={"rate": 3})
    file.write_text(example(variables="{rate: 2}"))
    assert patch_spec(selection, ["graph.nodes.relay.nice=3"]).notes == (
        "proved with --var rate=3, which the change does not have",
    )


@pytest.mark.parametrize(
    ("given", "sets", "added"),
    [
        ("graph.nodes.relay.nice=5", "graph.nodes.relay.nice=3", ["nice: 3"]),
        ("graph.nodes.relay.cpus=[0, 1]", "graph.nodes.relay.cpus[1]=3", ["cpus: [0, 3]"]),
        ("containers={main: {threads: 2}}", "containers.main.executor=multi_threaded",
         ["threads: 2", "executor: multi_threaded"]),
    ],
)  # fmt: skip
def test_what_the_deployment_sets_anew_is_in_the_file_with_the_value_around_it(
    tmp_path: Path, given: str, sets: str, added: list[str]
) -> None:
    file = tmp_path / "robot.r2b.yaml"
    file.write_text(example())
    beside = "title=robot"
    patch = patch_spec(SpecSelection(file, sets=[given, beside]), [sets])
    assert patch.file == file
    assert "title" not in patch.after
    for text in added:
        assert text in patch.after
    file.write_text(patch.after)
    found = load_spec(file, sets=[beside])
    file.write_text(example())
    assert found.spec == load_spec(file, sets=[given, beside, sets]).spec
    # A value that is replaced as a whole is nothing to speak of.
    around = (
        ()
        if given.startswith(sets.partition("=")[0])
        else (f"the change has --set {shlex.quote(given)}, too",)
    )
    assert patch.notes == (
        "proved with --set title=robot, which the change does not have",
        *around,
    )


def test_errors_say_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(
        UsageError, match=r"robot.r2b.yaml is not valid with graph.nodes.relay.nice"
    ):
        _patch(tmp_path, example(), "graph.nodes.relay.nice=300")
    file = tmp_path / "robot.r2b.yaml"
    outside = SpecSelection(file, sets=["graph.nodes.relay.nice=3"])
    assert patch_spec(outside, []).diff == ""
    with pytest.raises(UsageError, match="not readable"):
        patch_spec(SpecSelection(tmp_path / "none.r2b.yaml"), [])
