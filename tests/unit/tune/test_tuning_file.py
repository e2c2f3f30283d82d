"""``tuning.json``: what is written is read back, and nothing else is taken for it."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import tuning_results
from r2bspec.record.files import RecordError
from r2bspec.tune.tuning_result import TUNING_FILE, TuningResult, read_tuning, to_json, write_tuning


@pytest.mark.parametrize("made", [tuning_results.improved, tuning_results.not_met,
                                  tuning_results.hostile])  # fmt: skip
def test_a_result_is_read_back_and_written_to_the_same_bytes(
    tmp_path: Path, made: Callable[[], TuningResult]
) -> None:
    result = made()
    write_tuning(tmp_path, result)
    again = read_tuning(tmp_path)
    assert again == result
    assert to_json(again) == (tmp_path / TUNING_FILE).read_bytes()
    assert b"\x1b" not in to_json(result)


def _changed(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda content: content.update(values)


def _trial(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda content: content["trials"][1].update(values)


def _choice(**values: Any) -> Callable[[dict[str, Any]], None]:
    return lambda content: content["winner"]["choices"][0].update(values)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (_changed(r2bspec_tuning=2), "format version 2"),
        (_changed(trials=3), "Expected `array`"),
        (_changed(outcome="fine"), "Invalid enum"),
        (_changed(seed=10**30), "damaged"),
        (_changed(budget_s=1e300), "out of range"),
        (_trial(number=4), "numbered from 0"),
        (_trial(run="../other"), "outside of the folder"),
        (_trial(run="/etc"), "outside of the folder"),
        (_choice(place=9), "no setting 9 of 'graph.placement'"),
        (_choice(lever="graph.mine"), "no setting 1 of 'graph.mine'"),
        (_choice(setting={"text": "shared", "sets": ["a=b"]}), "no setting 1"),
    ],
)
def test_what_no_search_wrote_is_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], None], why: str
) -> None:
    content = json.loads(to_json(tuning_results.improved()))
    change(content)
    (tmp_path / TUNING_FILE).write_text(json.dumps(content))
    with pytest.raises(RecordError, match=why) as refused:
        read_tuning(tmp_path)
    assert refused.value.hint


def test_no_file_and_no_json(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="cannot be read") as refused:
        read_tuning(tmp_path)
    assert "r2bspec tune" in refused.value.hint
    (tmp_path / TUNING_FILE).write_bytes(b"[" * 100_000)
    with pytest.raises(RecordError, match="damaged"):
        read_tuning(tmp_path)
