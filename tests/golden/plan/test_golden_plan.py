"""Specs and their plans, byte for byte: canonical JSON, Mermaid and DOT.

With ``R2BSPEC_REWRITE=1`` in the environment the outputs are written instead of compared.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from r2bspec.check import check
from r2bspec.datasets.catalogue import describe
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.canonical_json import canonical_json
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.drawing import to_dot, to_mermaid
from r2bspec.plan.plan import Plan

HERE = Path(__file__).parent
FORMS: dict[str, Callable[[Plan], bytes]] = {
    ".json": canonical_json,
    ".mmd": lambda plan: to_mermaid(plan).encode(),
    ".dot": lambda plan: to_dot(plan).encode(),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("file", sorted(HERE.glob("*.yaml")), ids=lambda file: file.stem)
def test_a_plan(file: Path, form: str) -> None:
    loaded = load_spec(file)
    assert loaded.spec is not None
    assert not [each for each in check(loaded) if each.severity == "error"]
    full = compile_plan(loaded.spec, describe("r2b_storage"))
    # The version of r2bspec is part of a plan, but not of what is tested here.
    written = FORMS[form](msgspec.structs.replace(full, generator="r2bspec"))
    beside = file.with_suffix(form)
    if os.environ.get("R2BSPEC_REWRITE"):
        beside.write_bytes(written)
    assert written == beside.read_bytes()
