"""The one way in which a plan is written down, its hash, and reading it again.

Canonical form: JSON in UTF-8, keys sorted, two spaces of indentation, shortest floats that read
back the same, a newline at the end. Quantities and requirements are the strings of the language.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

import msgspec

from r2bspec.language import value_codec
from r2bspec.plan.errors import PLAN_BROKEN, PLAN_FOREIGN, PLAN_UNREADABLE, PlanError
from r2bspec.plan.plan import Plan
from r2bspec.untrusted.safe_file import read_bytes
from r2bspec.untrusted.safe_json import MAX_JSON_BYTES, decode_json

PLAN_VERSION = 1


class _PlanHeader(msgspec.Struct):
    """The fields that tell what a file is before its content is trusted."""

    r2bspec_plan: int
    generator: str = "an unknown generator"


def canonical_json(plan: Plan) -> bytes:
    """The plan's canonical form."""
    text = msgspec.json.encode(plan, enc_hook=value_codec.encode, order="sorted")
    return msgspec.json.format(text, indent=2) + b"\n"


def plan_hash(plan: Plan) -> str:
    """The hash that names a plan: ``sha256:`` and the digest of its canonical form."""
    return f"sha256:{hashlib.sha256(canonical_json(plan)).hexdigest()}"


def read_plan(path: Path) -> Plan:
    """Read a plan that `canonical_json` wrote; other spacing and order of keys do no harm.

    Raises:
        PlanError: the file cannot be read (R2B610), is no plan of this version (R2B611), or is a
            plan with a fault in it (R2B612).
    """
    try:
        data = read_bytes(path, max_bytes=MAX_JSON_BYTES)
    except OSError as error:
        raise PlanError(
            f"{path} cannot be read: {error.strerror or error}",
            code=PLAN_UNREADABLE,
            hint="'r2bspec plan SPEC -o FILE' writes one",
        ) from error
    return parse_plan(data, str(path))


def parse_plan(data: bytes, name: str) -> Plan:
    """Read a plan from its JSON; `name` is what messages call it.

    Raises:
        PlanError: as `read_plan`, but for R2B610.
    """
    _check_header(data, name)
    try:
        return decode_json(data, Plan, dec_hook=_decode)
    except msgspec.DecodeError as error:
        raise PlanError(
            f"{name} is a plan with a fault in it: {error}",
            code=PLAN_BROKEN,
            hint="write it anew with 'r2bspec plan SPEC -o FILE'; plans are not edited by hand",
        ) from error


def _check_header(data: bytes, name: str) -> None:
    hint = "'r2bspec plan SPEC -o FILE' writes a plan"
    try:
        head = decode_json(data, _PlanHeader)
    except msgspec.ValidationError as error:
        raise PlanError(
            f"{name} is JSON, but no plan of r2bspec: it has no 'r2bspec_plan'",
            code=PLAN_FOREIGN,
            hint=hint,
        ) from error
    except msgspec.DecodeError as error:
        raise PlanError(f"{name} is not JSON: {error}", code=PLAN_FOREIGN, hint=hint) from error
    if head.r2bspec_plan != PLAN_VERSION:
        raise PlanError(
            f"{name} is a plan of version {head.r2bspec_plan}, written by {head.generator};"
            f" this r2bspec reads version {PLAN_VERSION}",
            code=PLAN_FOREIGN,
            hint="write it anew with this version of r2bspec",
        )


def _decode(kind: type, value: object) -> object:
    try:
        return value_codec.decode(kind, value)
    except NotImplementedError as error:
        raise ValueError(str(error)) from error
