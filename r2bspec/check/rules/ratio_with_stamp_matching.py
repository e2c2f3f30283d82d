"""Ratios of outputs to inputs, where outputs are matched by stamp."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example, pluralize


def _find(context: Context) -> Findings:
    for name, monitor in context.spec.monitors.items():
        ratio = monitor.ratio
        if monitor.match == "stamp" and ratio.inputs != ratio.outputs:
            many = ratio.outputs > ratio.inputs
            yield Finding(
                message=f"monitor {name} matches by stamp, so its ratio cannot be "
                f"{pluralize(ratio.outputs, 'output')} to {pluralize(ratio.inputs, 'input')}",
                path=("monitors", name, "ratio"),
                help="use 'match: order'; by stamp, a second output with the same stamp is a "
                "duplicate"
                if many
                else "use 'match: order'; by stamp, every input needs an output with its stamp",
            )


RULE = Rule(
    code="R2B410",
    title="matching by stamp with a ratio other than one to one",
    severity="error",
    why="Matching by stamp pairs each output with the one input that has the same stamp. Any "
    "other ratio needs matching by order.",
    failing=example(
        monitors="""
            output:
              topic: output
              format: sensor_msgs/msg/Image
              ratio: {inputs: 2, outputs: 1}
        """
    ),
    passing=example(
        monitors="""
            output:
              topic: output
              format: sensor_msgs/msg/Image
              match: order
              ratio: {inputs: 2, outputs: 1}
        """
    ),
    find=_find,
)
