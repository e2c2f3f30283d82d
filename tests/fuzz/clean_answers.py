"""Which answers to hostile inputs are clean.

An answer is clean if it has a documented exit status other than that of an internal error, and a
message if it is no success; if errors of a call say what to do; if it has no traceback, no control
character and no secret; and if it took less than 500 MB of memory, few seconds of CPU, and a
bounded output.
"""

from __future__ import annotations

import re

from hostile_calls import Answer
from hostile_inputs import SECRET

MEMORY_BYTES = 500_000_000
OUTPUT_BYTES = 2_000_000
LINE_CHARACTERS = 4_100

_CONTROL = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f]|\xc2[\x80-\x9f]|\xe2\x80[\xaa-\xae]")
_PIECE = 8
"""A piece of a secret of this length must not be shown: enough to guess by."""


def wrong_with(answer: Answer, cpu_s: float, *, is_document: bool = False) -> str:
    """Why an answer is not clean; empty if it is.

    Args:
        answer: what was said.
        cpu_s: the processor time that it may take.
        is_document: whether it is for a program: then its lines may have any length.
    """
    said = answer.said
    longest = (
        0 if is_document else max(map(len, said.decode(errors="replace").splitlines() or [""]))
    )
    wrong = [
        *faults(answer.status, said),
        (answer.memory_bytes > MEMORY_BYTES, f"{answer.memory_bytes / 1e6:.0f} MB"),
        (answer.cpu_s > cpu_s, f"{answer.cpu_s:.1f} s of CPU"),
        (len(said) > OUTPUT_BYTES, f"{len(said):,} bytes of output"),
        (longest > LINE_CHARACTERS, f"a line of {longest:,} characters"),
    ]
    return ", ".join(what for is_wrong, what in wrong if is_wrong)


def faults(code: int, said: bytes) -> list[tuple[bool, str]]:
    """What may be wrong with an answer by its status and output, each with whether it is."""
    return [
        (code not in (0, 1, 2, 3, 4), f"exit status {code}"),
        (re.search(rb"Traceback|R2B69|R2B678", said) is not None, "a crash"),
        (code != 0 and not said.strip(), "no message"),
        (
            re.search(rb"(?m)^error\[", said) is not None and b"  help: " not in said,
            "an error without a way out",
        ),
        (_CONTROL.search(said) is not None, "control characters"),
        (_shows_secret(said), "a secret"),
    ]


def _shows_secret(said: bytes) -> bool:
    pieces = {SECRET[at : at + _PIECE] for at in range(len(SECRET) - _PIECE + 1)}
    return any(piece.encode() in said for piece in pieces)
