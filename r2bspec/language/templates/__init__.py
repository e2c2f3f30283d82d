"""Templates of specs: each is valid as it is, and documented by comments.

A template is a file ``NAME.r2b.yaml`` in this folder; its first comment states its purpose. The
files in ``specs/templates`` of the repository are generated from these by a test.
"""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

SUFFIX = ".r2b.yaml"

_NAME = re.compile(r"^name: .*$", re.MULTILINE)


@cache
def templates() -> dict[str, str]:
    """The text of every template, by name."""
    found = sorted(files(__name__).iterdir(), key=lambda file: file.name)
    return {
        file.name.removesuffix(SUFFIX): file.read_text(encoding="utf-8")
        for file in found
        if file.name.endswith(SUFFIX)
    }


def purpose(text: str) -> str:
    """The purpose of a template: the first sentence of its first comment."""
    lines = [line.removeprefix("#").strip() for line in text.split("\n\n")[0].splitlines()]
    return " ".join(lines).split(". ")[0].removesuffix(".")


def filled(template: str, name: str | None, schema: str) -> str:
    """The content of a spec made from a template.

    Args:
        template: the template's text.
        name: the name of the benchmark; None keeps that of the template.
        schema: the path of the JSON Schema for editors, relative to the spec.
    """
    line = f"# yaml-language-server: $schema={schema}\n\n"
    if name is None:
        return line + template
    return line + _NAME.sub(f"name: {name}", template, count=1)
