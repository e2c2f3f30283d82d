"""Mutants of a spec; ``python tests/mutation/mutation_score.py`` tells how many are found."""

from __future__ import annotations

import pytest
from mutants import KINDS, mutants

SMALL = """\
r2bspec: 1
labels: {a: 1, bee: x} # kept
monitors:
  out: {topic: image_out, format: p/msg/T}
"""


@pytest.fixture(autouse=True)
def _nowhere(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("PATH", "AMENT_PREFIX_PATH", "R2B_DATASETS"):
        monkeypatch.setenv(name, "")
    for name in ("AMENT_PREFIX_PATH", "R2B_DATASETS"):
        monkeypatch.delenv(name)


def test_mutants_of_a_small_spec() -> None:
    made = {mutant.label: mutant for mutant in mutants(SMALL)}
    assert {one.kind for one in made.values()} == set(KINDS)
    assert "labels: {bee: x} # kept" in made["delete    labels.a: is gone"].text
    assert "labels: {a: 1} # kept" in made["delete    labels.bee: is gone"].text
    assert "labels: {a: 1, be: x}" in made["misspell  labels.bee: bee -> be"].text
    assert "{a: 1, a: 1, bee: x}" in made["duplicate labels.a: stands twice"].text
    assert "{bee: 1, a: x}" in made["swap      labels.a: with bee"].text
    assert "labels" not in made["delete    labels: is gone"].text
    assert made["duplicate monitors: stands twice"].text == SMALL + "".join(
        line + "\n" for line in SMALL.splitlines()[2:]
    )
    assert made["duplicate monitors: stands twice"].lines == {3, 5}
    assert "topic: imag_out," in made["topic     monitors.out.topic: image_out -> imag_out"].text
    assert all(one.text != SMALL for one in made.values())
