"""Which kind of machine a run was made on: what runs must share to be compared."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any, Final

import msgspec

MACHINE_FACTS: Final = ("architecture", "cpu", "cores", "gpus", "cpu_governor")
"""The facts that decide how fast a machine is, and that do not change from day to day. The name of
the host is not among them: machines of one kind are exchangeable, as in a pool of CI runners."""

_FINGERPRINT_DIGITS = 12


def fingerprint(machine: Mapping[str, Any]) -> str:
    """Names the kind of machine, in twelve hexadecimal digits.

    Args:
        machine: as `RunRecord.machine` describes it; what is not known is taken as nothing.
    """
    facts = [machine.get(key) or None for key in MACHINE_FACTS]
    return hashlib.sha256(msgspec.json.encode(facts)).hexdigest()[:_FINGERPRINT_DIGITS]


def describe_machine(machine: Mapping[str, Any]) -> str:
    """The same for a reader, on one line."""
    cores = machine.get("cores")
    parts = (
        str(machine.get("cpu") or machine.get("architecture") or "an unknown machine"),
        f"{cores} cores" if cores else "",
        ", ".join(map(str, machine.get("gpus") or ())),
        str(machine.get("cpu_governor") or ""),
    )
    return " · ".join(each for each in parts if each)
