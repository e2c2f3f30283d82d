"""Keys that the loader evaluates: `extends`, `variables`, `matrix`, `repeat` and `when`."""

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
"""The types of variables."""

EXTENDS: Schema = loader_key(
    {
        **array(
            "The file that this one extends, relative to it, or several, in which later ones have "
            "precedence. Maps are merged, lists are replaced, and null removes a key.",
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
            f"The name of another {what} of the same map that this one extends. Maps are merged, "
            "lists are replaced, and null removes a key.",
            examples=["left"],
            form=name_patterns.SOME_TEXT,
        )
    )


def _values(description: str, value: str) -> Schema:
    """Values of variables by name."""
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
            f"Instances of the {what} by name, each with its own variables, which $(var NAME) in "
            "this entry refers to first. The instance left of camera is named camera_left.",
            name_patterns.INSTANCE,
            _values("The variables of one instance.", "The value of the variable."),
            examples=[{"left": {"side": "left"}, "right": {"side": "right"}}],
            at_least=1,
        )
    )


def when() -> Schema:
    """A condition on variables."""
    return _values(
        "The objective applies only if these variables have these values.",
        "The value that the variable must have.",
    )


VARIABLES: Schema = name_map(
    "Values for $(var name); --var name=value replaces one.",
    name_patterns.VARIABLE,
    {
        **record(
            "The value of the variable, or a map that declares it, with its value under 'value'.",
            {
                "type": choice("The type of the value.", list(TYPES), "string"),
                "value": scalar("The value.", examples=["30 Hz", 1280]),
                "default": scalar("The same as 'value'.", examples=["30 Hz", 1280]),
                "choices": array(
                    "The allowed values; empty means all.",
                    scalar("One of the values.", examples=["10 Hz"]),
                    examples=[["10 Hz", "30 Hz"]],
                ),
                "description": text(
                    "The purpose of the variable.", examples=["The camera's rate."]
                ),
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
        "Cases of this benchmark that differ in variables. Each case has its own verdict, under "
        "the name of the benchmark with the case in brackets: name[threads=2].",
        {
            "axes": name_map(
                "Variables with their values; every combination is a case.",
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
                "Combinations to leave out: all that have these values.",
                _values("Variables and values.", "The value."),
                examples=[[{"threads": 4, "rate": "60 Hz"}]],
            ),
            "cases": name_map(
                "Further cases by name, with the variables in which each differs.",
                name_patterns.NAME,
                _values("The variables of the case.", "The value."),
                examples=[{"night": {"bag": "r2b_lounge"}}],
            ),
        },
        examples=[{"axes": {"threads": [1, 2, 4]}}],
        snippets=[{"label": "a matrix", "body": {"axes": {"${1:variable}": ["$2", "$3"]}}}],
    )
)
