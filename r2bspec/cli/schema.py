"""``r2bspec schema``: print a JSON Schema, for editors and other programs."""

from __future__ import annotations

import importlib

import click

from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo_document

_SCHEMAS = {
    "spec": "r2bspec.language.json_schema:published_schema_text",
    "plan": "r2bspec.plan.canonical_json:plan_schema_text",
    "result": "r2bspec.report.result_json:result_schema_text",
}
"""Each schema and the function that generates it; printing one imports no other."""


@click.command("schema")
@click.argument("name", type=click.Choice(list(_SCHEMAS)), default="spec")
def command(name: str) -> int:
    """Print the JSON Schema of a spec, a plan or a result."""
    module, function = _SCHEMAS[name].split(":")
    echo_document(getattr(importlib.import_module(module), function)(), nl=False)
    return ExitStatus.OK
