"""What the loader uses up: `extends`, `variables`, `matrix` and `repeat`."""

from __future__ import annotations

from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.schema_builder import (
    PATH,
    SCALAR_TYPES,
    Schema,
    array,
    choice,
    loader_key,
    name_map,
    record,
    scalar,
    text,
)

TYPES = ("string", "integer", "number", "boolean", "duration", "rate", "size", "share")
"""What a variable may be declared to be."""

EXTENDS: Schema = loader_key(
    {
        **array(
            "The file that this one builds on, relative to it, or several, of which the later ones "
            "win. Maps are merged, lists replaced, and null removes.",
            text(
                "The path of a file.",
                form=name_patterns.NOT_EMPTY,
                examples=["base.yaml"],
                path=True,
            ),
            examples=["base.yaml", ["camera.yaml", "robot.yaml"]],
            at_least=1,
        ),
        "type": ["string", "array"],
        "minLength": 1,
        PATH: True,
    }
)


def sibling(what: str) -> Schema:
    """`extends` inside an entry of a map of named things."""
    return loader_key(
        text(
            f"The name of another {what} of the same map that this one builds on. Maps are "
            "merged, lists replaced, and null removes.",
            examples=["left"],
            form=name_patterns.SOME_TEXT,
        )
    )


def _values(description: str, value: str) -> Schema:
    """Values of variables by their names."""
    return name_map(
        description,
        name_patterns.VARIABLE,
        scalar(value, examples=[2, "30 Hz"]),
        examples=[{"threads": 2}],
    )


def repeat(what: str) -> Schema:
    """Named instances of one entry."""
    return loader_key(
        name_map(
            f"Instances of the {what} by their names, each with variables of its own, which "
            "$(var NAME) means here before all others. The instance left of camera is called "
            "camera_left.",
            name_patterns.INSTANCE,
            _values("The variables of one instance.", "The variable's value."),
            examples=[{"left": {"side": "left"}, "right": {"side": "right"}}],
            at_least=1,
        )
    )


def when() -> Schema:
    """A condition on variables."""
    return _values(
        "The objective counts only where these variables have these values.",
        "The value that the variable must have.",
    )


VARIABLES: Schema = name_map(
    "Values that $(var name) stands for; --var name=value replaces one.",
    name_patterns.VARIABLE,
    {
        **record(
            "The variable's value; or a map that declares it, with its value under 'value'.",
            {
                "type": choice("What the value must be.", list(TYPES), "string"),
                "value": scalar("The value.", examples=["30 Hz", 1280]),
                "default": scalar("The same as 'value'.", examples=["30 Hz", 1280]),
                "choices": array(
                    "The values that it may have; empty for all.",
                    scalar("One of the values.", examples=["10 Hz"]),
                    examples=[["10 Hz", "30 Hz"]],
                ),
                "description": text("What it is for.", examples=["The camera's rate."]),
            },
            examples=[],
        ),
        "type": [*SCALAR_TYPES, "object"],
        "examples": [1280, "30 Hz", {"type": "rate", "value": "30 Hz"}],
        "defaultSnippets": [
            {"label": "a value", "body": "$1"},
            {"label": "a typed value", "body": {"type": "${1:rate}", "value": "${2:30 Hz}"}},
        ],
    },
    examples=[{"width": 1280, "rate": "30 Hz"}],
)

MATRIX: Schema = loader_key(
    record(
        "Cases of this benchmark that differ in variables. Each has a verdict of its own, under "
        "the name of the benchmark with the case in brackets: name[threads=2].",
        {
            "axes": name_map(
                "Variables with the values that are combined, each with each.",
                name_patterns.VARIABLE,
                array(
                    "The values of the variable.",
                    scalar("One value.", examples=[1, "30 Hz"]),
                    examples=[[1, 2, 4]],
                    at_least=1,
                ),
                examples=[{"threads": [1, 2, 4]}],
            ),
            "exclude": array(
                "Combinations that are left out: all that have these values.",
                _values("Variables and values.", "The value."),
                examples=[[{"threads": 4, "rate": "60 Hz"}]],
            ),
            "cases": name_map(
                "Further cases by their names, with the variables in which each differs.",
                name_patterns.NAME,
                _values("The variables of the case.", "The value."),
                examples=[{"night": {"bag": "r2b_lounge"}}],
            ),
        },
        examples=[{"axes": {"threads": [1, 2, 4]}}],
        snippets=[{"label": "a matrix", "body": {"axes": {"${1:variable}": ["$2", "$3"]}}}],
    )
)
