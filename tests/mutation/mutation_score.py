"""What becomes of each mutant, and the score of it.

``python tests/mutation/mutation_score.py`` prints the score of the specs in ``specs/`` and what
survived; ``--write`` keeps it in ``SCORE.txt``, which a test compares.

Each mutant of a spec ends in one of these ways:

- at the line: something is reported where the mistake stands, or, for what was deleted, at its
  owner or where it is missed;
- elsewhere: something is reported, at another place;
- same: nothing is reported, and the plan is the same, so that nothing was changed;
- meant: nothing is reported, and the plan differs, and ``reasons`` says why the mutant is a spec
  that somebody may well have wanted;
- silent: nothing is reported, and there is no excuse for it.
"""

from __future__ import annotations

import os
import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from mutants import KINDS, Mutant, mutants
from mutation_reasons import reason

from r2bspec.check import check
from r2bspec.diagnostics import Diagnostic
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.plan.canonical_json import plan_hash
from r2bspec.plan.compile_plan import compile_plan

ROOT = Path(__file__).parents[2]
SPECS = sorted((ROOT / "specs").rglob("*.r2b.yaml"))
KEPT = Path(__file__).with_name("SCORE.txt")
FATES = ("at the line", "elsewhere", "same", "meant", "silent")


@dataclass(frozen=True, slots=True)
class Outcome:
    """A mutant and what became of it."""

    mutant: Mutant
    fate: str
    why: str = ""


def outcomes(spec: Path) -> Iterator[Outcome]:
    """What becomes of every mutant of a spec, which itself must have no errors."""
    text = spec.read_text(encoding="utf-8")
    loaded = load_spec(text, file=str(spec))
    usual = {_gist(one) for one in check(loaded)}
    plan = _plan(loaded)
    for mutant in mutants(text):
        yield _judge(mutant, str(spec), usual, plan)


def _judge(mutant: Mutant, file: str, usual: set[tuple[str, str]], plan: str) -> Outcome:
    loaded = load_spec(mutant.text, file=file)
    new = [one for one in check(loaded) if _gist(one) not in usual]
    if new:
        lines = {line for one in new for line in _lines(one)}
        if mutant.kind == "delete" or lines & mutant.lines:
            return Outcome(mutant, "at the line")
        return Outcome(mutant, "elsewhere", f"line {new[0].span.line}: {new[0].code}")
    if _plan(loaded) == plan:
        return Outcome(mutant, "same")
    why = reason(mutant)
    return Outcome(mutant, "meant" if why else "silent", why)


def _gist(found: Diagnostic) -> tuple[str, str]:
    return found.code, found.message


def _lines(found: Diagnostic) -> Iterator[int]:
    """The lines to which a finding points, but not the inner lines of a long value."""
    yield found.span.line
    for related in found.related:
        yield related.span.line


def _plan(loaded: LoadedSpec) -> str:
    from r2bspec.datasets.catalogue import index, locate

    if loaded.spec is None:
        return ""
    bags = [
        index(locate(source.dataset or source.path, loaded.base_dir))
        for source in loaded.spec.data_loader.sources
    ]
    return plan_hash(compile_plan(loaded.spec, bags))


def table(counts: Counter[tuple[str, str]]) -> Iterator[str]:
    """The counts by kind and fate, and two shares of them.

    `held` is what is at the line or the same; `clear` is that and what was meant.
    """
    yield (
        f"{'':<10}{'mutants':>9}"
        + "".join(f"{fate:>13}" for fate in FATES)
        + f"{'held':>9}{'clear':>9}"
    )
    for kind in (*KINDS, "all"):
        row = [
            sum(
                number
                for (one, of), number in counts.items()
                if of == fate and kind in (one, "all")
            )
            for fate in FATES
        ]
        if sum(row):
            held = share(row[0] + row[2], sum(row))
            clear = share(row[0] + row[2] + row[3], sum(row))
            numbers = "".join(f"{number:>13}" for number in row)
            yield f"{kind:<10}{sum(row):>9}{numbers}{held:>7.1f} %{clear:>7.1f} %"


def share(part: int, whole: int) -> float:
    """Percent, rounded down to a tenth, so that 100 means all."""
    return part * 1000 // whole / 10


def report(specs: Iterable[Path]) -> str:
    """The score as it is kept: a table, and every mutant that is not held, with its reason."""
    counts: Counter[tuple[str, str]] = Counter()
    rest: list[str] = []
    for spec in specs:
        name = spec.relative_to(ROOT).as_posix()
        for outcome in outcomes(spec):
            counts[outcome.mutant.kind, outcome.fate] += 1
            if outcome.fate in ("elsewhere", "meant", "silent"):
                why = outcome.why or "no reason"
                rest.append(f"{outcome.fate:<10} {name}: {outcome.mutant.label} | {why}")
    head = "Written by mutation_score.py, which explains the words. What is not held is listed."
    return "\n".join([head, "", *table(counts), "", *sorted(rest)]) + "\n"


def kept_shares(text: str) -> dict[str, float]:
    """The share of each kind that is clear, from a score as it is kept."""
    rows = re.findall(r"^(\w+) .* ([\d.]+) %$", text, flags=re.MULTILINE)
    return {kind: float(number) for kind, number in rows}


def without_a_machine() -> None:
    """Leave out of account what happens to be installed here."""
    os.environ["PATH"] = ""
    os.environ.pop("AMENT_PREFIX_PATH", None)
    os.environ.pop("R2B_DATASETS", None)


if __name__ == "__main__":
    without_a_machine()
    score = report(SPECS)
    if "--write" in sys.argv:
        KEPT.write_text(score, encoding="utf-8")
    sys.stdout.write(score)
