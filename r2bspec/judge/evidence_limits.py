"""What a decision on shares and means cannot know, as notes of its verdict.

A test takes account of what the run has shown. It cannot take account of bursts that happened not
to occur, one iteration does not show by how much iterations differ, and few that resemble each
other carry too little information to know by how much they do.
"""

from __future__ import annotations

from typing import Final

from r2bspec.judge.decision import Question
from r2bspec.judge.verdict import Outcome, ShareTest
from r2bspec.judge.verdict_wording import counted_noun
from r2bspec.measure.units import show

_FEW_BURSTS: Final = 5
_LONG_BURST: Final = 20.0
"""Messages; a run whose PASS withstands bursts of this mean length needs no note on them."""

_FEW_INDEPENDENT: Final = 2.0


def share_notes(question: Question, test: ShareTest, outcome: Outcome) -> tuple[str, ...]:
    """The notes on a percentile or a share."""
    if outcome == "inconclusive":
        return ()
    bursts = _unseen_bursts(question, test) if outcome == "pass" else ()
    return (*bursts, *piece_notes(question))


def piece_notes(question: Question) -> tuple[str, ...]:
    """That a single iteration was played; none with two or more."""
    if len(question.iterations) > 1:
        return ()
    return ("One iteration does not show by how much iterations differ.",)


def correlation_notes(pieces: str, number: int, inflation: float) -> tuple[str, ...]:
    """That iterations or starts resemble each other by more than a test can take account of.

    Args:
        pieces: what they are.
        number: how many.
        inflation: their F (`r2bspec.judge.statistics.autocorrelation`).
    """
    left = number / inflation
    if left >= _FEW_INDEPENDENT:
        return ()
    note = (
        f"Successive {pieces} may resemble each other: {number} carry the information of about "
        f"{left:.1f} independent ones, too few for a test to be sure of its confidence."
    )
    return (note,)


def _unseen_bursts(question: Question, test: ShareTest) -> tuple[str, ...]:
    """That the run met too few bursts to know how long they get."""
    withstands = test.withstands
    if test.bursts >= _FEW_BURSTS or withstands is None or withstands >= _LONG_BURST:
        return ()
    seen = "no burst" if not test.bursts else "1 burst" if test.bursts == 1 else ""
    seen = seen or f"{show(test.bursts, 'count')} bursts"
    note = (
        f"The run met {seen} of {counted_noun(question)} on the wrong side of the limit: too few "
        f"to know how long bursts get. The PASS allows for a mean length of up to "
        f"{show(withstands, '', 2)}."
    )
    return (note,)
