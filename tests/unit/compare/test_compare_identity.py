"""Promise: what is compared with a run of other code says what changed in the code."""

from __future__ import annotations

from pathlib import Path

import msgspec
import pytest

from pair_simulation import Comparison, latencies
from r2bspec.compare.comparison import differences_of, read_compared_result
from r2bspec.compare.report_input import ReportInput, judge_comparison_folder
from r2bspec.judge.judge_run import from_json, result_of, to_json
from r2bspec.judge.result import Result
from r2bspec.record.comparison_folder import open_comparison
from r2bspec.record.graph_identity import (
    FileDigest,
    GraphIdentity,
    NodeIdentity,
    Revision,
    identity_digest,
    node_digest,
)
from r2bspec.record.run_folder import RunFolder, open_run
from r2bspec.report.format_registry import renderer
from run_simulation import Played, Simulation

MAIN = Revision("9b1e44f" + "0" * 33, dirty=False, name="origin/main")
CURRENT = Revision("3f2a1c4" + "0" * 33, dirty=True)


def identity(content: str, numpy: str = "2.1", revision: Revision | None = None) -> GraphIdentity:
    node = NodeIdentity(kind="python", digest="", files=(FileDigest("nodes/blur.py", content),))
    nodes = {"blur": msgspec.structs.replace(node, digest=node_digest(node))}
    packages = {"numpy": numpy}
    return GraphIdentity(
        digest=identity_digest(nodes, packages), nodes=nodes, packages=packages, revision=revision
    )


BASE, HEAD = identity("1", revision=MAIN), identity("2", "2.2", revision=CURRENT)
CHANGES = ("blur.py changed", "numpy 2.1 → 2.2")


def identify(folder: Path, found: GraphIdentity | None, run_id: str = "") -> None:
    record = open_run(folder).record
    changed = msgspec.structs.replace(record, identity=found, run_id=run_id or record.run_id)
    RunFolder(folder).write_record(changed)


def write_run(folder: Path, found: GraphIdentity | None) -> Path:
    Simulation(segments=[Played(30.0, latencies(0.02))] * 3).write(folder)
    identify(folder, found)
    return folder


def text(result: Result, name: str) -> str:
    return renderer(name)(ReportInput(result=result)).decode()


def test_a_comparison_in_pairs_names_what_changed(tmp_path: Path) -> None:
    Comparison([0.02] * 4, [0.02] * 4).write(tmp_path)
    for number in range(1, 5):
        identify(tmp_path / "base" / f"{number:03d}", BASE)
        identify(tmp_path / "head" / f"{number:03d}", HEAD)
    result = judge_comparison_folder(open_comparison(tmp_path)).result
    assert (result.base_identity, result.identity) == (BASE, HEAD)
    assert result.changes == CHANGES
    assert from_json(to_json(result)) == result
    for name in ("text", "junit"):
        assert "head 3f2a1c4+dirty, base origin/main@9b1e44f" in text(result, name)
        assert "blur.py changed, numpy 2.1 → 2.2" in text(result, name)
    assert "head 3f2a1c4+dirty, base origin/main" in text(result, "markdown")
    assert "| revision | 3f2a1c4+dirty |" in text(result, "markdown")


def test_a_side_whose_code_changed_meanwhile_has_no_identity(tmp_path: Path) -> None:
    Comparison([0.02] * 4, [0.02] * 4).write(tmp_path)
    for number in range(1, 5):
        identify(tmp_path / "base" / f"{number:03d}", BASE)
        identify(tmp_path / "head" / f"{number:03d}", HEAD if number < 3 else BASE)
    result = judge_comparison_folder(open_comparison(tmp_path)).result
    assert result.base_identity == BASE
    assert result.identity is None
    assert result.changes == ()


def test_a_run_alone_names_its_revision(tmp_path: Path) -> None:
    result = result_of(open_run(write_run(tmp_path / "run", HEAD)))
    assert "revision 3f2a1c4+dirty" in text(result, "text")
    assert result.changes == ()
    unknown = result_of(open_run(write_run(tmp_path / "unknown", None)))
    assert "revision" not in text(unknown, "text")


def test_runs_that_are_compared_differ_in_their_code(tmp_path: Path) -> None:
    base, head, unknown = (
        read_compared_result(write_run(tmp_path / name, found))
        for name, found in (("base", BASE), ("head", HEAD), ("unknown", None))
    )
    assert [*differences_of(base, head)] == [f"code: {change}" for change in CHANGES]
    assert [*differences_of(base, unknown)] == []


@pytest.mark.parametrize("name", ["html", "markdown", "text", "junit", "github"])
def test_a_comparison_that_ended_before_any_run_is_reported(tmp_path: Path, name: str) -> None:
    Comparison([0.02] * 2, [0.02] * 2).write(tmp_path)
    result = judge_comparison_folder(open_comparison(tmp_path)).result
    nothing = msgspec.structs.replace(
        result, status="incomplete", machine={}, dataset={}, versions={}, identity=None
    )
    assert text(nothing, name)
