"""Real comparisons of a relay with itself and with slower ones: how often the gate says what.

    PYTHONPATH=.:tests/support python benchmarks/regressions.py            # about 15 minutes
    PYTHONPATH=.:tests/support python benchmarks/regressions.py --quick    # about 3

Each series is one ``run --against`` on real ROS 2: a RelayNode whose service time is 20 ms, against
one that is 0, 5, 10 or 20 % slower, asked for at most 3 % more latency at 20 Hz and at most 3 %
less throughput at 60 Hz, which is more than it can do. Series of all changes are made in turn, in a
random order, until the time is over; what is under way then is finished.

Printed is a table of counts, as docs/verdicts.md shows it: how many series called the head worse
(FAIL), not worse (PASS), or could not tell; and how far pairs of the unchanged graph differed.
Folders of all series are kept with ``--output``, and can be judged again.
"""

from __future__ import annotations

import json
import os
import random
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import yaml
from measuring import machine, options, show, table, tell

from r2bspec import api
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from ros_runs import relay_node, relay_spec, write_bag

CHANGES = (0, 5, 10, 20)
"""Percent by which the head's service time is longer."""

SERVICE_MS = 20.0

REQUIREMENTS = {
    "latency": {"at": "20 Hz", "require": ["latency.p50 <= 103 % of baseline"]},
    "throughput": {"at": "60 Hz", "require": ["throughput.mean >= 97 % of baseline"]},
}
OUTCOMES = {"fail": "worse", "pass": "not worse", "inconclusive": "can't tell"}


@dataclass(frozen=True)
class Asked:
    """What the command line asks for."""

    minutes: float
    pairs: int
    seconds: int
    confirm: bool
    output: Path
    seed: int


def main() -> int:
    asked = _parse()
    spec = _write_spec(asked)
    counts: dict[tuple[int, str], Counter[str]] = defaultdict(Counter)
    noise: dict[str, list[float]] = defaultdict(list)
    began = time.monotonic()
    for number, change in enumerate(_changes(asked.seed)):
        # Every change once, whatever that takes; then as long as there is time.
        if number >= len(CHANGES) and time.monotonic() - began > asked.minutes * 60:
            break
        result = _series(spec, change, asked, asked.output / f"series-{number:03d}-{change}")
        for objective in REQUIREMENTS:
            said, one = _said(result, objective)
            counts[change, objective][said] += 1
            if change == 0 and one is not None and one.compared is not None:
                noise[objective].append(one.compared.deviation or 0.0)
            tell(
                f"{time.monotonic() - began:6.0f} s  {change:2d} %  {objective:10}  {said:10}  "
                f"{one.reason if one is not None else ''}"
            )
    _show(counts, noise, asked, time.monotonic() - began)
    return 0


def _parse() -> Asked:
    parser = options(__doc__)
    parser.add_argument("--minutes", type=float, default=15.0, help="start no series after these")
    parser.add_argument("--pairs", type=int, default=5, help="of each series")
    parser.add_argument("--seconds", type=int, default=1, help="of each iteration")
    parser.add_argument("--confirm", action="store_true", help="confirm failures by fresh pairs")
    parser.add_argument("--quick", action="store_true", help="every change once, three pairs")
    parser.add_argument("--output", type=Path, help="keep the folders there")
    parser.add_argument("--seed", type=int, default=1, help="of the order of changes")
    given = parser.parse_args()
    return Asked(
        minutes=0.0 if given.quick else given.minutes,
        pairs=3 if given.quick else given.pairs,
        seconds=given.seconds,
        confirm=given.confirm,
        output=(given.output or Path(tempfile.mkdtemp(prefix="r2bspec-regressions-"))).absolute(),
        seed=given.seed,
    )


def _changes(seed: int) -> Iterator[int]:
    """All changes in turn, each time in another order."""
    order = random.Random(seed)  # noqa: S311 - an order, no secret
    while True:
        yield from order.sample(CHANGES, len(CHANGES))


def _write_spec(asked: Asked) -> Path:
    asked.output.mkdir(parents=True, exist_ok=True)
    write_bag(asked.output / "bag", {"/camera": range(0, 330, 33)})
    spec = relay_spec(
        variables={"ms": SERVICE_MS},
        graph={"nodes": {"relay": relay_node()}},
        benchmark={
            "duration": f"{asked.seconds} s",
            "iterations": asked.pairs,
            "rates": ["20 Hz", "60 Hz"],
            "warm_up": "500 ms",
            "start_timeout": "60 s",
            "gate": {"confirm": asked.confirm},
        },
        slos=REQUIREMENTS,
    )
    parameters = spec["graph"]["nodes"]["relay"]["parameters"]
    # Overload fills the queue; it is to be empty again before the next iteration.
    parameters |= {"service_time_ms": "$(var ms)", "queue_depth": 5}
    path = asked.output / "relay.r2b.yaml"
    path.write_text(yaml.safe_dump(spec, sort_keys=False))
    return path


def _series(spec: Path, change: int, asked: Asked, folder: Path) -> Result | None:
    """One comparison; None if it failed."""
    head = api.prepare(spec, variables={"ms": SERVICE_MS * (1 + change / 100)})
    try:
        if change == 0:
            return api.run_pairs(head, output=folder, control=True)
        return api.run_pairs(
            head,
            [f"var:ms={SERVICE_MS}"],
            folder,
            prepare_base=lambda _: api.prepare(spec, variables={"ms": SERVICE_MS}),
        )
    except R2bspecError as error:
        tell(f"{folder.name}: {error}")
        if error.exit_code == ExitStatus.INTERRUPTED:
            raise
        return None


def _said(result: Result | None, objective: str) -> tuple[str, RequirementVerdict | None]:
    if result is None or result.verdict.outcome in {"invalid", "incomplete"}:
        return "invalid", None
    one = next(each for each in result.verdict.requirements if each.objective == objective)
    return OUTCOMES[one.outcome], one


def _show(
    counts: dict[tuple[int, str], Counter[str]],
    noise: dict[str, list[float]],
    asked: Asked,
    seconds: float,
) -> None:
    said = (*OUTCOMES.values(), "invalid")
    rows = [
        [f"{change} %", objective, f"{found.total()}", *(str(found[each]) for each in said)]
        for (change, objective), found in sorted(counts.items())
    ]
    show(
        f"{asked.pairs} pairs of {asked.seconds} s, {machine()}, load "
        f"{os.getloadavg()[0]:.1f} at the end, {seconds / 60:.0f} minutes"
        + (", failures confirmed" if asked.confirm else ""),
        "",
        *table(("slower by", "metric", "series", *said), rows),
    )
    for objective, deviations in sorted(noise.items()):
        show("", f"noise of {objective} in pairs of equals: {max(deviations):.1%} at most")
    kept = {f"{change} {objective}": dict(found) for (change, objective), found in counts.items()}
    (asked.output / "counts.json").write_text(json.dumps(kept, indent=1) + "\n")
    tell(f"kept in {asked.output}")


if __name__ == "__main__":
    sys.exit(main())
