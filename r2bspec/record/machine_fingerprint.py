"""The fingerprint of a machine, which runs must share to be comparable."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, Final

import msgspec

MACHINE_FACTS: Final = ("architecture", "cpu", "cores", "gpus", "cpu_governor")
"""The facts that determine the speed of a machine and are constant over time. They do not include
the host name: machines of one kind are interchangeable, as in a pool of CI runners."""

_FINGERPRINT_DIGITS = 12


def fingerprint(machine: Mapping[str, Any]) -> str:
    """Identifies the kind of machine, with twelve hexadecimal digits.

    Args:
        machine: as in `RunRecord.machine`; unknown facts are ignored.
    """
    facts = [machine.get(key) or None for key in MACHINE_FACTS]
    return hashlib.sha256(msgspec.json.encode(facts)).hexdigest()[:_FINGERPRINT_DIGITS]


def describe_machine(machine: Mapping[str, Any]) -> str:
    """The description of a machine, on one line."""
    cores = machine.get("cores")
    parts = (
        str(machine.get("cpu") or machine.get("architecture") or "an unknown machine"),
        f"{cores} cores" if cores else "",
        ", ".join(map(str, machine.get("gpus") or ())),
        str(machine.get("cpu_governor") or ""),
    )
    return " · ".join(each for each in parts if each)
