"""Commands that get no ROS arguments, because the spec says nothing of ROS about them."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Rule, example


def _find(context: Context) -> Findings:
    for _, node in context.nodes:
        if not node.is_ros_process:
            yield Finding(
                message=f"{node.key} is run exactly as written, without ROS arguments: its nodes "
                f"keep their own names, and are not in the namespace {node.namespace}",
                path=(*node.path, "command"),
                help="if it is a ROS node, state its topics with 'subscribes:' and 'publishes:'",
            )


RULE = Rule(
    code="R2B234",
    title="command without ROS arguments",
    severity="info",
    why="A command may be any program, and may refuse arguments that it does not know. It gets "
    "--ros-args with the namespace, the remappings and the parameters only if the spec states one "
    "of these, or its topics.",
    failing=example(
        graph="""
            nodes:
              detector:
                command: [sh, ./detector.sh]
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image}
        """
    ),
    passing=example(
        graph="""
            nodes:
              detector:
                command: [sh, ./detector.sh]
                subscribes: {image: sensor_msgs/msg/Image}
              relay:
                python: r2bspec.nodes.RelayNode
                remappings: {input: image}
        """
    ),
    find=_find,
)
