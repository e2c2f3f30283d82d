"""The values that checks take and give."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec

from r2bspec.execute.host.machine import interpreter
from r2bspec.middleware.middleware import SHARED_MEMORY

Status = Literal["ok", "warn", "problem"]

_WORST: tuple[Status, ...] = ("problem", "warn", "ok")


class CheckResult(msgspec.Struct, frozen=True, kw_only=True):
    """One thing looked at.

    `found` says what is there, `advice` what to do about it (empty where nothing need be done),
    and `data` holds the numbers for programs.
    """

    topic: str
    name: str
    status: Status
    found: str
    advice: str = ""
    data: dict[str, Any] = {}


@dataclass(frozen=True)
class System:
    """Where checks look, so that a test can show them another machine."""

    proc: Path = Path("/proc")
    sys: Path = Path("/sys")
    shared_memory: Path = SHARED_MEMORY
    runs: Path = Path("runs")
    python: str = field(default_factory=interpreter)
    environ: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))


def worst_status(checks: list[CheckResult]) -> Status:
    """The worst status of all, which is that of the machine."""
    found = {check.status for check in checks}
    return next((status for status in _WORST if status in found), "ok")


def read_text(path: Path) -> str | None:
    """What a file of the kernel says, or None where this kernel has no such file."""
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return None


def read_int(path: Path) -> int | None:
    """The number in a file of the kernel, or None where there is none."""
    text = read_text(path)
    return int(text) if text is not None and text.removeprefix("-").isdigit() else None
