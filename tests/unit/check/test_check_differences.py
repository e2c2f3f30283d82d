"""What a run finds to be otherwise stands where validate would have found it."""

from __future__ import annotations

from pathlib import Path

import pytest

from r2bspec.check.rule import differences_to_diagnostics, failure_to_diagnostics
from r2bspec.diagnostics.diagnostic import Severity
from r2bspec.language.load_spec import load_spec
from r2bspec.record.run_record import Difference

SPEC = Path(__file__).with_name("differences.r2b.yaml").read_text(encoding="utf-8")


def difference(
    code: str, part: str, owner: str, name: str, topic: str = "", *, harmless: bool = False
) -> Difference:
    return Difference(
        code=code,
        message="it differs",
        part=part,  # type: ignore[arg-type]
        owner=owner,
        name=name,
        topic=topic,
        harmless=harmless,
    )


@pytest.mark.parametrize(
    ("found", "line", "word"),
    [
        (difference("R2B211", "parameter", "/r2b/first", "rtae"), 13, "rtae"),
        (difference("R2B204", "remapping", "/r2b/first", "outptu"), 14, "outptu"),
        (difference("R2B208", "endpoint", "player", "/r2b/image"), 6, "image"),
        (difference("R2B207", "endpoint", "", "/r2b/last"), 20, "last"),
        (difference("R2B210", "endpoint", "monitor", "/r2b/last"), 20, "last"),
        (difference("R2B216", "endpoint", "/r2b/second", "/r2b/between"), 18, "between"),
        # What the component has instead, because its remapping is misspelt.
        (difference("R2B208", "endpoint", "", "/r2b/last", "/r2b/image"), 14, "image"),
        (difference("R2B665", "parameter", "/r2b/first", "rtae"), 13, "rtae"),
        (difference("R2B665", "parameter", "/r2b/second", "required"), 15, "second"),
        (difference("R2B665", "node", "/r2b/second", ""), 15, "second"),
        (difference("R2B605", "lifecycle", "/r2b/second", "configure"), 15, "second"),
        # A topic that is nowhere in the spec: the node that has it.
        (difference("R2B207", "endpoint", "/r2b/first", "/r2b/unheard_of"), 9, "first"),
    ],
)
def test_a_difference_is_placed_at_what_makes_it(found: Difference, line: int, word: str) -> None:
    loaded = load_spec(SPEC, file="spec.r2b.yaml", environ={})
    (placed,) = differences_to_diagnostics([found], loaded)
    assert (placed.code, placed.severity) == (found.code, Severity.ERROR)
    assert placed.span.line == line
    text = SPEC.splitlines()[line - 1]
    assert text[placed.span.column - 1 :].startswith(word)


@pytest.mark.parametrize(
    ("blamed", "place"),
    [
        ("first", (9, 5)),
        ("/r2b/second", (15, 5)),
        ("cpp", (22, 3)),
        ("harness.player", None),
    ],
)
def test_a_process_that_ends_or_hangs_has_its_place(
    blamed: str, place: tuple[int, int] | None
) -> None:
    text = f"{SPEC.rstrip()}\ncontainers:\n  cpp: {{executable: component_container}}\n"
    loaded = load_spec(text, file="spec.r2b.yaml", environ={})
    found = failure_to_diagnostics("it was killed by SIGSEGV", "R2B631", "read", blamed, loaded)
    assert [(each.code, (each.span.line, each.span.column)) for each in found] == (
        [("R2B631", place)] if place else []
    )


def test_what_did_no_harm_is_a_warning_and_all_are_sorted_by_place() -> None:
    loaded = load_spec(SPEC, file="spec.r2b.yaml", environ={})
    placed = differences_to_diagnostics(
        [
            difference("R2B207", "endpoint", "", "/r2b/last"),
            difference("R2B204", "remapping", "/r2b/first", "outptu", harmless=True),
        ],
        loaded,
    )
    assert [(each.span.line, each.severity) for each in placed] == [
        (14, Severity.WARNING),
        (20, Severity.ERROR),
    ]
