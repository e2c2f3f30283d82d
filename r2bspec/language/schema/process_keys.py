"""Settings of processes, shared by nodes, containers and steps."""

from __future__ import annotations

from r2bspec.language.quantities import Size
from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.reuse import sibling
from r2bspec.language.schema.schema_builder import (
    Schema,
    array,
    choice,
    deferrable,
    integer,
    name_map,
    quantity,
    record,
    text,
)

ENV: Schema = name_map(
    "Environment variables of the process.",
    name_patterns.ENVIRONMENT,
    deferrable(text("The value of the variable.", examples=["4"])),
    examples=[{"OMP_NUM_THREADS": "4"}],
)


def words(description: str, *, at_least: int = 0, examples: list[list[str]]) -> Schema:
    """A command line, or a part of one."""
    word = deferrable(text("An argument.", examples=[examples[0][0]]))
    return array(description, word, at_least=at_least, examples=examples)


RESOURCES: dict[str, Schema] = {
    "cpus": array(
        "The CPUs on which the process may run; empty means all.",
        integer("The number of a CPU, counted from 0.", minimum=0, examples=[0, 2]),
        examples=[[2, 3]],
    ),
    "nice": integer(
        "The niceness of the process; values below 0 raise its priority and need the permission to "
        "do so.",
        minimum=-20,
        maximum=19,
        default=0,
        examples=[-5],
    ),
    "prefix": words(
        "Words before the command line, such as a profiler.",
        examples=[["perf", "record", "-g"]],
    ),
    "memory_limit": quantity(
        Size,
        "The maximum resident memory of the process; if it is exceeded, the run fails.",
        examples=["2 GiB"],
        positive=True,
    ),
}
"""Resources of a process, in the order of the language."""

CONTAINERS: Schema = name_map(
    "Processes for several nodes, by the names that nodes refer to.",
    name_patterns.NODE_NAME,
    record(
        "A process for several nodes.",
        {
            "extends": sibling("container"),
            "executable": choice(
                "The kind of container: one of rclcpp_components for plugins, or python for Python "
                "nodes.",
                [
                    "component_container",
                    "component_container_mt",
                    "component_container_isolated",
                    "python",
                ],
                "component_container",
            ),
            "executor": choice(
                "With python: whether callbacks run one after another or in parallel.",
                ["single_threaded", "multi_threaded"],
                "single_threaded",
            ),
            "threads": integer(
                "The number of threads of the executor; 0 means its default.",
                minimum=0,
                default=0,
                examples=[4],
            ),
            "env": ENV,
            **RESOURCES,
        },
        examples=[{"executable": "component_container_mt", "threads": 4}],
    ),
    examples=[{"vision": {"executable": "component_container_mt"}}],
    snippets=[
        {
            "label": "a container",
            "body": {"${1:name}": {"executable": "${2:component_container_mt}"}},
        }
    ],
)
