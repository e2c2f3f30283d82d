"""Ratios of outputs to inputs for messages that say which input they answer."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example


def _find(context: Context) -> Findings:
    for name, monitor in context.spec.monitors.items():
        ratio = monitor.ratio
        if monitor.match == "stamp" and ratio.inputs != ratio.outputs:
            many = ratio.outputs > ratio.inputs
            yield Finding(
                message=f"monitor {name} matches by stamp, where {ratio.outputs} to {ratio.inputs} "
                "cannot be",
                path=("monitors", name, "ratio"),
                help="a second output with the same stamp counts as a duplicate; write "
                "'match: order'"
                if many
                else "every input waits for an output with its stamp; write 'match: order'",
            )


RULE = Rule(
    code="R2B410",
    title="a ratio of a monitor that matches by stamp",
    severity="error",
    why="By stamp each output answers the one input that carries the same. How many outputs answer "
    "how many inputs is a matter of their order.",
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
