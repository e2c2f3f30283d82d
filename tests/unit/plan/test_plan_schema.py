"""Plans obey their schema."""

from __future__ import annotations

import copy
import json
from typing import Any

import pytest
from jsonschema import Draft202012Validator
from plan_specs import PREPROCESSED, STRAIGHT, plan

from r2bspec.plan.canonical_json import canonical_json, plan_schema


def test_the_schema_is_one() -> None:
    Draft202012Validator.check_schema(plan_schema())


@pytest.mark.parametrize("document", [PREPROCESSED, STRAIGHT], ids=["preprocessed", "straight"])
def test_plans_obey_it(document: dict[str, Any]) -> None:
    Draft202012Validator(plan_schema()).validate(json.loads(canonical_json(plan(document))))


@pytest.mark.parametrize("change", [{"unknown": 1}, {"buffer": "10"}, {"r2bspec_plan": 2}])
def test_what_is_no_plan_does_not(change: dict[str, Any]) -> None:
    document = copy.deepcopy(json.loads(canonical_json(plan())))
    assert not Draft202012Validator(plan_schema()).is_valid({**document, **change})
