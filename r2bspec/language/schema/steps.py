"""`setup`, `ready` and `after_ready`: steps around the start of the graph."""

from __future__ import annotations

from r2bspec.language.quantities import Duration
from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.process_keys import ENV, words
from r2bspec.language.schema.schema_builder import (
    DEFERRABLE,
    Schema,
    name_map,
    quantity,
    record,
    text,
)


def _timeout(what: str, default: str) -> Schema:
    return quantity(
        Duration,
        f"The maximum duration of the {what}; if it is exceeded, the run fails.",
        default=default,
        examples=[default],
        positive=True,
    )


_MODEL = {
    "command": ["trtexec", "--onnx=model.onnx", "--saveEngine=model.plan"],
    "creates": "model.plan",
}

SETUP: Schema = name_map(
    "Commands that run once, in this order, before anything else is started.",
    name_patterns.NAME,
    record(
        "A command that runs before anything else is started.",
        {
            "command": words(
                "The program with its arguments, one item each, run without a shell.",
                at_least=1,
                examples=[["./build_model.sh"]],
            ),
            "creates": text(
                "The file that the command creates. If it exists, the command is skipped; while it "
                "is being created, other runs wait.",
                examples=["model.plan"],
                path=True,
            ),
            "timeout": _timeout("command", "10 min"),
            "directory": text(
                "The working directory; default: the folder of this file.",
                examples=["./models"],
                path=True,
            ),
            "env": ENV,
        },
        required=["command"],
        examples=[_MODEL],
    ),
    examples=[{"model": _MODEL}],
    snippets=[
        {"label": "a step", "body": {"${1:name}": {"command": ["$2"], "creates": "${3:file}"}}}
    ],
)

READY: Schema = name_map(
    "Conditions for the graph to be ready, in addition to all publishers and subscriptions being "
    "matched.",
    name_patterns.NAME,
    record(
        "A readiness probe: exactly one of 'file', 'service', 'log' and 'topic'.",
        {
            "file": text("A file that exists.", examples=["model.plan"], path=True),
            "service": text(
                "A service that is available.",
                form=name_patterns.TOPIC,
                examples=["detector/set_parameters"],
            ),
            "log": record(
                "A line in the output of a process.",
                {
                    "process": text(
                        "The node or the container whose output is read.",
                        form=name_patterns.NODE_NAME,
                        examples=["detector"],
                    ),
                    "pattern": text(
                        "A regular expression to find in the line, in RE2 syntax.",
                        form=name_patterns.SOME_TEXT,
                        examples=["model loaded"],
                    ),
                },
                required=["process", "pattern"],
                examples=[{"process": "detector", "pattern": "model loaded"}],
            ),
            "topic": text(
                "A topic that is published.",
                form=name_patterns.TOPIC,
                examples=["detector/status"],
            ),
            "timeout": _timeout("wait", "30 s"),
        },
        examples=[{"log": {"process": "detector", "pattern": "model loaded"}}],
    ),
    examples=[{"model_loaded": {"log": {"process": "detector", "pattern": "model loaded"}}}],
    snippets=[
        {"label": "a service", "body": {"${1:name}": {"service": "$2"}}},
        {"label": "a log line", "body": {"${1:name}": {"log": {"process": "$2", "pattern": "$3"}}}},
    ],
)

_CALL = record(
    "A service call.",
    {
        "name": text("The service.", form=name_patterns.TOPIC, examples=["detector/enable"]),
        "type": text(
            "Its type, as 'ros2 service list -t' shows it.",
            form=name_patterns.SERVICE_TYPE,
            examples=["std_srvs/srv/SetBool"],
        ),
        "request": name_map(
            "The fields of the request; omitted fields have their defaults.",
            name_patterns.PARAMETER,
            {
                "description": "The value of the field: a scalar, a list or a map.",
                "examples": [True, 1.5],
                DEFERRABLE: True,
            },
            examples=[{"data": True}],
        ),
    },
    required=["name", "type"],
    examples=[
        {"name": "detector/enable", "type": "std_srvs/srv/SetBool", "request": {"data": True}}
    ],
)

AFTER_READY: Schema = name_map(
    "Steps that run once, in this order, when the graph is ready and before playing starts.",
    name_patterns.NAME,
    record(
        "A step: exactly one of 'command' and 'service'.",
        {
            "command": {
                **words(
                    "The program with its arguments, one item each, run without a shell.",
                    at_least=1,
                    examples=[["ros2", "lifecycle", "set", "/r2b/detector", "activate"]],
                ),
            },
            "service": _CALL,
            "timeout": _timeout("step", "30 s"),
        },
        examples=[{"service": {"name": "detector/enable", "type": "std_srvs/srv/Trigger"}}],
    ),
    examples=[{"enable": {"service": {"name": "detector/enable", "type": "std_srvs/srv/Trigger"}}}],
    snippets=[
        {
            "label": "a service call",
            "body": {"${1:name}": {"service": {"name": "$2", "type": "$3"}}},
        }
    ],
)
