"""Promise: hostile inputs are answered cleanly, and no answer shows a secret."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

import pytest
from clean_answers import wrong_with
from hostile_calls import LONGEST_CPU_S, call
from hostile_inputs import PLACES, SECRET, SECRET_NAME, WORDS, secret_spec
from readers import answered

from data_bags import text, write_bag
from nightly import size
from pipelines import Workplace
from r2bspec.report.finding_formats import FORMATS


@pytest.mark.parametrize("place", PLACES)
def test_no_verb_shows_a_secret_wherever_a_spec_writes_it(
    place: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(SECRET_NAME, SECRET)
    write_bag(tmp_path / "bag", [("/a", 0, text("x"))])
    options = ([], ["--diff"], ["--resolved"], *(["--format", name] for name in FORMATS))
    for word in WORDS[:: size(2, 1)]:
        Path("h.r2b.yaml").write_text(secret_spec(place, word), encoding="utf-8")
        calls = [("validate", "--offline", *words, "h.r2b.yaml") for words in options]
        answered(("plan", "h.r2b.yaml"), *calls)


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


@pytest.mark.parametrize("place", ["name", "command", "require"])
def test_the_gate_passes_no_hostile_spec_and_shows_no_secret(place: str, tmp_path: Path) -> None:
    """The script of the action on a repository that forges results and asks for a secret."""
    there = Workplace(tmp_path / "checkout", tmp_path / "temp")
    there.checkout.mkdir()
    there.runner.mkdir()
    write_bag(there.checkout / "bag", [("/a", 0, text("x"))])
    for name, content in [("h.r2b.yaml", secret_spec(place, WORDS[0])), *GATE]:
        there.write(name, content)
    ended = there.action(
        sys.executable, "h.r2b.yaml", **{SECRET_NAME: SECRET, "R2BSPEC_UNTRUSTED": "true"}
    )
    assert ended.code not in (0, 70), ended.printed
    assert ended.outputs["outcome"] in ("fail", "invalid", "error")
    shown = ended.printed + ended.summary + str(ended.outputs)
    assert not any(SECRET[at : at + 8] in shown for at in range(len(SECRET) - 7))
    token = re.search(r"^::stop-commands::(\w+)$", ended.printed, re.MULTILINE)
    assert token is not None
    between = ended.printed.split(token[0])[1].split(f"::{token[1]}::")[0]
    assert not re.search(r"^\s*::(?!stop)", between, re.MULTILINE)
