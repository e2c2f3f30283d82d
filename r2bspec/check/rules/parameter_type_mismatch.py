"""Parameter values of another type than the node declares."""

from __future__ import annotations

from r2bspec.check.certainty import as_version_warning, with_record
from r2bspec.check.parameter_types import ParameterOverride, parameter_overrides, parameter_type
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, value_key
from r2bspec.diagnostics.quote import clip
from r2bspec.wiring.node_interface import ParameterInfo


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        for each in parameter_overrides(context, node):
            declared = (node.interface.parameters or {}).get(each.name)
            given = parameter_type(each.value)
            if declared is None or given is None or declared.type in {"", given}:
                continue
            source = node.interface.parameters_from
            found = _finding(node.key, each, given, declared)
            finding = with_record(context, found, (node, source))
            if source == "catalogue":
                finding = as_version_warning(node.interface, finding)
            yield finding


def _finding(node: str, each: ParameterOverride, given: str, declared: ParameterInfo) -> Finding:
    path, value = each.path, each.value
    article = "an" if declared.type[0] in "aeiou" else "a"
    also = "an" if given[0] in "aeiou" else "a"
    fixed = f"{value}.0" if given == "integer" and declared.type == "double" else None
    return Finding(
        message=f"parameter {quote(each.name)} of {node} is {article} {declared.type}, but "
        f"{clip(str(value))} is {also} {given}" + (f" in {quote(each.file)}" if each.file else ""),
        path=path,
        help=f"write {fixed}; ROS does not convert integers to doubles"
        if fixed
        else "remove the quotes"
        if given == "string" and declared.type in {"integer", "double", "bool"}
        else "",
        replacement=None if each.file else fixed,
        suppresses={value_key(path)},
    )


RULE = Rule(code="R2B212", find=_find)
