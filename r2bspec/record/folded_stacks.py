"""Folded stacks of a profile: each stack on a line, with the number of its samples.

The frames are separated by semicolons, from the first called to the last, as flamegraph.pl and
py-spy write them: ``main;work;memcpy 42``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from r2bspec.record.atomic_files import write_atomically
from r2bspec.safe_io.safe_file import read_bytes

Stacks = Mapping[tuple[str, ...], int]
"""The number of samples by the frames of their stack, the first called first."""

_MAX_BYTES = 64 << 20


def write_stacks(path: Path, stacks: Stacks) -> None:
    """Write a file of folded stacks.

    Raises:
        RecordError: the file system refuses.
    """
    lines = [f"{';'.join(map(_frame, stack))} {count}\n" for stack, count in sorted(stacks.items())]
    write_atomically(path, "".join(lines).encode(errors="replace"))


def read_stacks(path: Path, folder: Path) -> Stacks:
    """Read a file of folded stacks below a folder; lines that are not such are left out.

    Raises:
        RefusedFileError: it is too large, is no file, or leads out of the folder.
        OSError: it cannot be read.
    """
    found: dict[tuple[str, ...], int] = {}
    content = read_bytes(path, max_bytes=_MAX_BYTES, folders=[folder])
    for line in content.decode(errors="replace").splitlines():
        frames, _, count = line.rpartition(" ")
        if frames and count.isascii() and count.isdecimal() and len(count) < 16:
            stack = tuple(frames.split(";"))
            found[stack] = found.get(stack, 0) + int(count)
    return found


def _frame(name: str) -> str:
    return " ".join(name.replace(";", ":").split()) or "[unknown]"
