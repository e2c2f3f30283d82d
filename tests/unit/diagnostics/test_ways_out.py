"""Every error says what to do about it: where it is raised, or as its class."""

from __future__ import annotations

import ast
import contextlib
import importlib
import pkgutil
from collections.abc import Iterator
from pathlib import Path

import r2bspec
from r2bspec.errors import R2bspecError

PACKAGE = Path(r2bspec.__file__).parent


def error_classes() -> dict[str, type[R2bspecError]]:
    """Those whose way out is that of each error: they make none of their own.

    What is a built-in error, too, is a reason that another error gives, with its way out. What the
    language server refuses is shown by an editor, which has no place for one.
    """
    for module in pkgutil.walk_packages(r2bspec.__path__, "r2bspec."):
        if not module.name.endswith("__main__"):
            with contextlib.suppress(ImportError):  # of ROS or of an extra
                importlib.import_module(module.name)
    found: dict[str, type[R2bspecError]] = {}
    waiting: list[type[R2bspecError]] = [R2bspecError]
    while waiting:
        kind = waiting.pop()
        waiting += kind.__subclasses__()
        if kind.__module__.startswith("r2bspec.language_server"):
            continue
        makes_it = kind is not R2bspecError and "__init__" in vars(kind)
        if not makes_it and not issubclass(kind, OSError | ValueError):
            found[kind.__name__] = kind
    return found


def calls() -> Iterator[tuple[str, str, ast.Call]]:
    for file in sorted(PACKAGE.rglob("*.py")):
        if "language_server" in file.parts:
            continue
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                # `click.UsageError` prints the usage, and where the help is.
                name = ast.unparse(node.func).removeprefix("errors.")
                yield f"{file.relative_to(PACKAGE)}:{node.lineno}", name, node


def test_every_error_has_a_way_out() -> None:
    known = error_classes()
    assert "UsageError" in known
    without = [
        f"{place}: {name}"
        for place, name, call in calls()
        if name in known
        and not known[name].way_out
        and not any(word.arg in {"hint", None} for word in call.keywords)
    ]
    assert without == []


def test_a_hint_takes_the_place_of_the_way_out() -> None:
    class OwnError(R2bspecError):
        way_out = "Do this."

    assert (OwnError("x").hint, OwnError("x", hint="Do that.").hint) == ("Do this.", "Do that.")
