"""Promise: every hostile input of every family is answered cleanly; the share is printed.

The inputs are the same each time. `R2BSPEC_FUZZ_INPUTS` sets how many there are of each family.
"""

from __future__ import annotations

import os
import random
import re
import sys
from pathlib import Path

import pytest
from clean_answers import Tally, run_inputs, wrong_with
from hostile_calls import LONGEST_CPU_S, call
from hostile_inputs import SECRET, SECRET_NAME, Prototypes, families

from nightly import size
from pipelines import Workplace

INPUTS = int(os.environ.get("R2BSPEC_FUZZ_INPUTS", size(2, 12)))
SEED = 2026


@pytest.mark.timeout(60 * max(INPUTS, 10))
def test_every_hostile_input_is_answered_cleanly(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # No time is asserted: the limit of CPU only ends what would not end.
    tally = run_inputs(tmp_path, iter(range(INPUTS)), SEED, LONGEST_CPU_S)
    with capsys.disabled():
        sys.stdout.write("".join(f"\n{line}" for line in tally.lines()))
    assert tally.unclean == []
    assert tally.clean == tally.calls
    assert len(tally.calls) == 4
    assert min(tally.calls.values()) >= INPUTS


def test_what_is_not_clean_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    answers = {
        "crash": (lambda _: 1 // 0, "a crash"),
        "status": (lambda _: 70, "exit status 70"),
        "silent": (lambda _: 2, "no message"),
        "dead": (lambda _: os.abort(), "exit status -6"),
        "memory": (lambda _: len(bytearray(b"x") * 600_000_000) and 0, " MB"),
        "secret": (lambda _: sys.stdout.write(SECRET[4:16]) and 0, "a secret"),
        "control": (lambda _: sys.stdout.write("\x1b]0;x") and 0, "control characters"),
        "line": (lambda _: sys.stdout.write("x" * 10_000) and 0, "a line of 10,000 characters"),
        "output": (lambda _: sys.stdout.write("x\n" * 2_000_000) and 0, "bytes of output"),
        "clean": (lambda _: 0, ""),
    }
    for name, (main, wrong) in answers.items():
        monkeypatch.setattr("r2bspec.cli.main.main", main)
        found = wrong_with(call("x", cwd=tmp_path), LONGEST_CPU_S)
        assert wrong in found if wrong else not found, (name, found)
    assert Tally().unclean == []


GATE = [
    ("r2bspec-reports/result.json", '{"verdict": {"outcome": "pass\\nstatus=0"}}'),
    ("reports/result.json", '{"verdict": {"outcome": "pass"}}'),
    ("run/record.json", '{"status": "complete"}'),
    ("json.py", "print('outcome=pass'); raise SystemExit(0)\n"),
    ("sitecustomize.py", "raise SystemExit(0)\n"),
    ("r2bspec/__init__.py", "raise SystemExit(0)\n"),
    ("r2bspec/__main__.py", "raise SystemExit(0)\n"),
    ("h.noise.json", '{"outcome": "pass"}'),
    ("pyproject.toml", "[tool.r2bspec]\noutcome = 'pass'\n"),
    (".r2bspec", "status=0\n"),
]


@pytest.mark.parametrize("number", range(3))
def test_the_gate_passes_no_hostile_spec_and_shows_no_secret(number: int, tmp_path: Path) -> None:
    """The script of the action on a repository that forges results and asks for a secret."""
    place = Workplace(tmp_path / "checkout", tmp_path / "temp")
    place.checkout.mkdir()
    place.runner.mkdir()
    (tmp_path / "prototypes").mkdir()
    rng = random.Random(f"{SEED} {number} gate")  # noqa: S311 - nothing is secret
    made = families(Prototypes(tmp_path / "prototypes"))["secrets"](rng, place.checkout)
    for name, content in rng.sample(GATE, 6):
        place.write(name, content)
    ended = place.action(
        sys.executable, "h.r2b.yaml", **{SECRET_NAME: SECRET, "R2BSPEC_UNTRUSTED": "true"}
    )
    assert ended.code not in (0, 70), (made.name, ended.printed)
    assert ended.outputs["outcome"] in ("fail", "invalid", "error")
    shown = ended.printed + ended.summary + str(ended.outputs)
    assert not any(SECRET[at : at + 8] in shown for at in range(len(SECRET) - 7))
    token = re.search(r"^::stop-commands::(\w+)$", ended.printed, re.MULTILINE)
    assert token is not None
    between = ended.printed.split(token[0])[1].split(f"::{token[1]}::")[0]
    assert not re.search(r"^\s*::(?!stop)", between, re.MULTILINE)
