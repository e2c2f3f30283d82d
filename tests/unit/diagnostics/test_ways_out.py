"""Every error says what to do about it: where it is raised, or as its class."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import r2bspec
from r2bspec.errors import R2bspecError

PACKAGE = Path(r2bspec.__file__).parent


# What the language server refuses is shown by an editor, which has no place for a way out; what the
# harness reports, by the controller, which names the log of the process where there is no hint.
@cache
def modules() -> dict[Path, ast.Module]:
    """Each module of the package, by its path; parsed where a test needs it, not in each worker."""
    return {
        file.relative_to(PACKAGE): ast.parse(file.read_text(encoding="utf-8"))
        for file in sorted(PACKAGE.rglob("*.py"))
        if not {"language_server", "harness"} & {*file.parts}
    }


@cache
def classes() -> dict[str, ast.ClassDef]:
    return {
        node.name: node
        for module in modules().values()
        for node in ast.walk(module)
        if isinstance(node, ast.ClassDef)
    }


def lineage(name: str) -> Iterator[str]:
    """A class and all those that it extends, by their names."""
    yield name
    for base in classes()[name].bases if name in classes() else ():
        yield from lineage(ast.unparse(base).rpartition(".")[2])


def defines(name: str, attribute: str) -> bool:
    """Whether a class itself has a function, or a value that is not empty, of this name."""
    for node in classes()[name].body if name in classes() else ():
        if isinstance(node, ast.FunctionDef) and node.name == attribute:
            return True
        if isinstance(node, ast.Assign | ast.AnnAssign) and isinstance(node.value, ast.Constant):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            if any(ast.unparse(target) == attribute for target in targets):
                return bool(node.value.value)
    return False


def needs_a_hint(name: str) -> bool:
    """Whether nothing but a hint can say what to do about an error of this class.

    A class that makes its own errors says it there. What is a built-in error, too, is a reason that
    another error gives, with its way out.
    """
    kinds = [*lineage(name)]
    if "R2bspecError" not in kinds or {"OSError", "ValueError"} & {*kinds}:
        return False
    makes_it = name != "R2bspecError" and defines(name, "__init__")
    return not makes_it and not any(defines(kind, "way_out") for kind in kinds)


def name_of(called: ast.expr) -> str:
    """The class of r2bspec that an expression names, by itself or as a part of ``errors``."""
    if isinstance(called, ast.Attribute) and isinstance(called.value, ast.Name):
        return called.attr if called.value.id == "errors" else ""
    return called.id if isinstance(called, ast.Name) else ""


def test_every_error_has_a_way_out() -> None:
    assert needs_a_hint("UsageError")
    calls = (
        (f"{file}:{node.lineno}", name_of(node.func), node.keywords)
        for file, module in modules().items()
        for node in ast.walk(module)
        if isinstance(node, ast.Call)
    )
    # `click.UsageError` prints the usage, and where the help is.
    without = [
        f"{place}: {name}"
        for place, name, keywords in calls
        if needs_a_hint(name) and not any(word.arg in {"hint", None} for word in keywords)
    ]
    assert without == []


def test_a_hint_takes_the_place_of_the_way_out() -> None:
    class OwnError(R2bspecError):
        way_out = "Do this."

    assert (OwnError("x").hint, OwnError("x", hint="Do that.").hint) == ("Do this.", "Do that.")
