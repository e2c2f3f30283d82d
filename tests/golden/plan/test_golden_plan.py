"""A spec with everything that a plan can have, and its plan: canonical JSON, Mermaid and DOT.

With ``R2BSPEC_REWRITE=1`` in the environment the outputs are written instead of compared.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from golden import compare
from r2bspec.check import check
from r2bspec.datasets.catalogue import describe
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.drawing import to_mermaid
from r2bspec.plan.plan import Plan

SPEC = Path(__file__).with_name("whole_plan.yaml")
SUITE = sorted((Path(__file__).parents[3] / "specs" / "suite").glob("*.r2b.yaml"))
FORMS: dict[str, Callable[[Plan], bytes]] = {
    ".json": canonical_json,
    ".mmd": lambda plan: to_mermaid(plan).encode(),
}


def plan_of(file: Path, *refused: str) -> Plan:
    """The plan of a spec in which `check` finds nothing of these severities."""
    loaded = load_spec(file)
    assert loaded.spec is not None
    assert not [finding for finding in check(loaded) if finding.severity in refused]
    dataset = loaded.spec.data_loader.bag.dataset
    full = compile_plan(loaded.spec, describe(dataset) if dataset else None)
    # The version of r2bspec is part of a plan, but not of what is tested here.
    return msgspec.structs.replace(full, generator="r2bspec")


@pytest.mark.parametrize("form", FORMS)
def test_a_plan(form: str) -> None:
    compare(FORMS[form](plan_of(SPEC, "error")), SPEC.with_suffix(form))
