"""The input and the results of checks."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import msgspec

from r2bspec.middleware.middleware import SHARED_MEMORY

Status = Literal["ok", "warn", "problem"]

_WORST: tuple[Status, ...] = ("problem", "warn", "ok")


class CheckResult(msgspec.Struct, frozen=True):
    """The result of one check.

    `found` is the observation, `advice` what to do about it (empty if nothing), and `data` has the
    values for programs.
    """

    topic: str
    name: str
    status: Status
    found: str
    advice: str = ""
    data: dict[str, Any] = {}


def advised(
    topic: str,
    name: str,
    found: str,
    advice: str,
    data: dict[str, Any] | None = None,
    *,
    otherwise: Status = "warn",
) -> CheckResult:
    """Return the result of a check that is good if there is no advice."""
    return CheckResult(topic, name, otherwise if advice else "ok", found, advice, data or {})


@dataclass(frozen=True)
class System:
    """The paths and the environment that checks use; tests replace them."""

    proc: Path = Path("/proc")
    sys: Path = Path("/sys")
    shared_memory: Path = SHARED_MEMORY
    runs: Path = Path("runs")
    python: str = field(default_factory=lambda: sys.executable)
    environ: Mapping[str, str] = field(default_factory=lambda: dict(os.environ))


def worst_status(checks: list[CheckResult]) -> Status:
    """Return the worst status of some checks, which is that of the machine."""
    statuses = {check.status for check in checks}
    return next((status for status in _WORST if status in statuses), "ok")


def read_text(path: Path) -> str | None:
    """Return the content of a file of the kernel; None if it does not exist."""
    try:
        return path.read_text(errors="replace").strip()
    except OSError:
        return None


def read_int(path: Path) -> int | None:
    """Return the number in a file of the kernel; None without a number."""
    text = read_text(path)
    return int(text) if text is not None and text.removeprefix("-").isdigit() else None
