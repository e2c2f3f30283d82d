"""Parameters that the node does not declare."""

from __future__ import annotations

from r2bspec.check.certainty import as_version_warning, with_record
from r2bspec.check.parameter_types import parameter_overrides
from r2bspec.check.rule_api import Context, Finding, Findings, Rule, quote, suggestion

# Every node accepts these, and qos_overrides of its topics.
_COMMON_PARAMETERS = ("use_sim_time", "start_type_description_service")


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        declared = node.interface.parameters
        if declared is None:
            continue
        for each in parameter_overrides(context, node):
            # A parameter file may contain parameters of other nodes.
            if each.name in declared or each.file or _is_common_parameter(each.name):
                continue
            finding = Finding(
                message=f"{node.key} declares no parameter {quote(each.name)}",
                path=each.path,
                key=True,
                help=suggestion(each.name, declared, "its parameters"),
            )
            source = node.interface.parameters_from
            finding = with_record(context, finding, (node, source))
            yield as_version_warning(node.interface, finding) if source == "catalogue" else finding


def _is_common_parameter(name: str) -> bool:
    return name in _COMMON_PARAMETERS or name.startswith("qos_overrides.")


RULE = Rule(code="R2B211", find=_find)
