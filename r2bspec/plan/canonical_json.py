"""The canonical JSON of a plan, its hash, reading it, and its JSON Schema.

Canonical form: JSON in UTF-8, sorted keys, indentation of two spaces, shortest floats that can be
read back exactly, control characters and bidirectional marks as escapes, a newline at the end.
Quantities and requirements are strings of the language.
"""

from __future__ import annotations

import hashlib
import inspect
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from r2bspec.diagnostics.plain_text import escaped_json
from r2bspec.errors import ExitStatus, R2bspecError
from r2bspec.language.benchmark_defaults import MIN_CONFIDENCE
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.declaration import decode_text, encode_text
from r2bspec.language.quantities import Quantity
from r2bspec.plan.plan import Plan
from r2bspec.safe_io.limits import MAX_JSON_BYTES, MAX_PROCESSES
from r2bspec.safe_io.safe_file import read_bytes
from r2bspec.safe_io.safe_json import decode_json

PLAN_UNREADABLE: Final = "R2B610"
PLAN_FOREIGN: Final = "R2B611"
PLAN_BROKEN: Final = "R2B612"


class PlanError(R2bspecError):
    """A file cannot be used as a plan. The message names the file; `hint` is the remedy."""

    code = PLAN_BROKEN
    exit_code = ExitStatus.USAGE


PLAN_VERSION = 1
_WRITE_ONE: Final = "write a plan with 'r2bspec plan SPEC -o FILE'"

_PASSED_ON = frozenset({"parameters", "request", "labels"})
"""Fields whose numbers go to nodes and reports as they are."""


class _PlanHeader(msgspec.Struct):
    """The fields that identify a file before its content is decoded."""

    r2bspec_plan: int
    generator: str = "an unknown generator"


def canonical_json(plan: Plan) -> bytes:
    """Return the canonical form of a plan."""
    text = msgspec.json.encode(plan, enc_hook=encode_text, order="sorted")
    return escaped_json(msgspec.json.format(text, indent=2) + b"\n")


def plan_hash(plan: Plan) -> str:
    """Return the hash that identifies a plan: ``sha256:`` and the digest of its canonical form."""
    return f"sha256:{hashlib.sha256(canonical_json(plan)).hexdigest()}"


def read_plan(path: Path) -> Plan:
    """Read a plan written by `canonical_json`; spacing and the order of keys may differ.

    Raises:
        PlanError: the file cannot be read (R2B610), is not a plan of this version (R2B611), or is
            an invalid plan (R2B612).
    """
    try:
        data = read_bytes(path, max_bytes=MAX_JSON_BYTES)
    except OSError as error:
        raise PlanError(
            f"{path} cannot be read: {error.strerror or error}",
            code=PLAN_UNREADABLE,
            hint=_WRITE_ONE,
        ) from error
    return parse_plan(data, str(path))


def parse_plan(data: bytes, name: str) -> Plan:
    """Read a plan from its JSON; `name` is its name in messages.

    Raises:
        PlanError: as for `read_plan`, except R2B610.
    """
    _check_header(data, name)
    try:
        plan = decode_json(data, Plan, dec_hook=_decode, free=_PASSED_ON)
        _check_content(plan)
    except (msgspec.DecodeError, ValueError) as error:
        raise PlanError(
            f"{name} is an invalid plan: {error}",
            code=PLAN_BROKEN,
            hint="do not edit plans; write a new one with 'r2bspec plan SPEC -o FILE'",
        ) from error
    return plan


def _check_content(plan: Plan) -> None:
    """See that a plan has what its types do not say.

    Raises:
        ValueError: it has not.
    """
    if len(plan.processes) > MAX_PROCESSES:
        raise ValueError(f"it has more than {MAX_PROCESSES:,} processes")
    for name, objective in plan.objectives.items():
        confidence = objective.confidence
        if confidence is not None and not MIN_CONFIDENCE <= confidence.fraction < 1:
            place = f"at `$.objectives.{name}.confidence`"
            raise ValueError(f"a confidence is {MIN_CONFIDENCE} or more, and below 1 - {place}")
    monitors = Counter(monitor.name for monitor in plan.monitors)
    if twice := next((name for name, count in monitors.items() if count > 1), None):
        raise ValueError(f"there are two monitors {twice!r} - at `$.monitors`")


def _check_header(data: bytes, name: str) -> None:
    try:
        head = decode_json(data, _PlanHeader)
    except msgspec.DecodeError as error:
        is_json = isinstance(error, msgspec.ValidationError)
        why = "not a plan of r2bspec: it has no 'r2bspec_plan'" if is_json else f"not JSON: {error}"
        raise PlanError(f"{name} is {why}", code=PLAN_FOREIGN, hint=_WRITE_ONE) from error
    if head.r2bspec_plan != PLAN_VERSION:
        raise PlanError(
            f"{name} is a plan of version {head.r2bspec_plan}, written by {head.generator};"
            f" this r2bspec reads version {PLAN_VERSION}",
            code=PLAN_FOREIGN,
            hint="write a new plan with this version of r2bspec",
        )


def _decode(kind: type, value: object) -> object:
    try:
        return decode_text(kind, value)
    except NotImplementedError as error:
        raise ValueError(str(error)) from error


SCHEMA_FILE_NAME = "r2bspec-plan-v1.schema.json"


def document_schema(
    kind: type[msgspec.Struct],
    file_name: str,
    title: str,
    schema_hook: Callable[[type], dict[str, Any]] | None = None,
) -> dict[str, Any]:
    """Return a schema as published in ``schemas/``: JSON Schema draft 2020-12.

    Args:
        kind: the type of the document.
        file_name: the file name of the schema.
        title: the title of the schema.
        schema_hook: as for `msgspec.json.schema_components`.
    """
    (reference,), components = msgspec.json.schema_components(
        [kind], schema_hook=schema_hook, ref_template="#/$defs/{name}"
    )
    for component in components.values():
        # Python 3.13 and msgspec 0.23 take the indentation off docstrings; the file must not
        # depend on them.
        component["description"] = inspect.cleandoc(component.get("description", ""))
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": file_name,
        "title": title,
        **reference,
        "$defs": components,
    }


def schema_text(schema: dict[str, Any]) -> str:
    """Return a schema as a file, with a newline at its end."""
    return json.dumps(schema, indent=2, sort_keys=True, ensure_ascii=False) + "\n"


def plan_schema() -> dict[str, Any]:
    """Return the schema of plans."""
    return document_schema(
        _with_quantities_required(),
        SCHEMA_FILE_NAME,
        "A plan of r2bspec, version 1",
        _string_type,
    )


def _with_quantities_required() -> type[msgspec.Struct]:
    """`Plan`, but defaults that are quantities, which msgspec cannot write, are none."""
    fields = [
        (field.name, field.type, msgspec.NODEFAULT)
        if isinstance(field.default, Quantity)
        else (field.name, field.type, _default(field))
        for field in msgspec.structs.fields(Plan)
    ]
    namespace = {"__doc__": Plan.__doc__}
    return msgspec.defstruct(
        "Plan", fields, namespace=namespace, kw_only=True, forbid_unknown_fields=True
    )


def _default(field: msgspec.structs.FieldInfo) -> Any:
    if field.default_factory is not msgspec.NODEFAULT:
        return msgspec.field(default_factory=field.default_factory)
    return field.default


def plan_schema_text() -> str:
    """Return the schema of plans as a file."""
    return schema_text(plan_schema())


def _string_type(kind: type) -> dict[str, Any]:
    """Values of the language that are strings in every document."""
    if issubclass(kind, Quantity):
        return {"type": "string", "title": kind.__name__, "examples": [kind.example]}
    if issubclass(kind, Requirement):
        return {"type": "string", "title": "Requirement", "examples": ["latency.p99 < 50 ms"]}
    raise NotImplementedError(f"{kind.__name__} has no schema")
