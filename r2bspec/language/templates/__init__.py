"""Templates of specs: each is valid as it is, and documented by comments.

A template is a file ``NAME.r2b.yaml`` in this folder; its first comment states its purpose. The
files in ``specs/templates`` of the repository are generated from these by a test.
"""

from __future__ import annotations

import re
from functools import cache
from importlib.resources import files

from r2bspec.language.names import NODE_NAME

SUFFIX = ".r2b.yaml"

_NODE = re.compile(r"^    my_node:\n      python: (?P<target>\S+)\n", re.MULTILINE)
_WORD_START = re.compile(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])")
_PROCESS_NAMES = frozenset({"loader", "player", "monitor", "harness", "graph", "system"})
"""Names of processes of a run, which a node of a template should not have."""

_NAME = re.compile(r"^name: .*$", re.MULTILINE)


@cache
def templates() -> dict[str, str]:
    """Return the text of every template, by name."""
    template_files = sorted(files(__name__).iterdir(), key=lambda file: file.name)
    return {
        file.name.removesuffix(SUFFIX): file.read_text(encoding="utf-8")
        for file in template_files
        if file.name.endswith(SUFFIX)
    }


def purpose(text: str) -> str:
    """Return the purpose of a template: the first sentence of its first comment."""
    lines = [line.removeprefix("#").strip() for line in text.split("\n\n")[0].splitlines()]
    return " ".join(lines).split(". ")[0].removesuffix(".")


def node_key(target: str, name: str = "") -> str:
    """Return the key of a node: its own name, if its source gives it a valid name.

    Otherwise the key is derived from its class, or from its file if it is a function such as
    `main`.
    """
    if re.search(NODE_NAME.pattern, name) and name not in _PROCESS_NAMES:
        return name
    place, _, name = target.rpartition(":") if ":" in target else target.rpartition(".")
    if name in {"main", "make", "create"}:
        name = place.rpartition("/")[2].removesuffix(".py").rpartition(".")[2]
    words = _WORD_START.sub("_", name.removesuffix("Node") or name).lower()
    key = re.sub(r"[^a-z0-9_]+", "_", words).strip("_") or "node"
    return f"{key}_node" if key in _PROCESS_NAMES or key[0].isdigit() else key


def has_node(template: str) -> bool:
    """Return True if a template has a Python node under test."""
    return _NODE.search(template) is not None


def with_node(template: str, target: str = "") -> str:
    """Return a template with `target` as its node under test, under a key derived from it."""

    def named(match: re.Match[str]) -> str:
        written = target or match["target"]
        quoted = f'"{written}"' if ":" in written else written
        return f"    {node_key(written)}:\n      python: {quoted}\n"

    return _NODE.sub(named, template, count=1)


_EDITORS = "# Completion and checks in editors: 'r2bspec docs editors'"
"""In place of a schema."""


def filled(template: str, name: str | None, schema: str) -> str:
    """Return the content of a spec made from a template.

    Args:
        template: the template's text.
        name: the name of the benchmark; None keeps that of the template.
        schema: the path of the JSON Schema for editors, relative to the spec; empty for none.
    """
    line = f"# yaml-language-server: $schema={schema}\n\n" if schema else f"{_EDITORS}\n\n"
    if name is None:
        return line + template
    return line + _NAME.sub(f"name: {name}", template, count=1)
