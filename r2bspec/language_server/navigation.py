"""Going to definitions, finding references, and renaming."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path as FilePath
from typing import Final

from r2bspec.check.python_target import python_target
from r2bspec.diagnostics import Span
from r2bspec.errors import R2bspecError
from r2bspec.exit_status import ExitStatus
from r2bspec.language.located_tree import ScalarNode, lookup
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.places import place_at
from r2bspec.language_server.python_files import definitions_in
from r2bspec.language_server.symbols import (
    Occurrence,
    Symbol,
    occurrence_at,
    places_of,
)
from r2bspec.wiring.name_resolution import expand

_NAME: Final = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_TOPIC: Final = re.compile(r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*\Z")


class RenameError(R2bspecError):
    """A name that cannot be changed, or not to this one."""

    code = "R2B602"
    exit_code = ExitStatus.USAGE


def definitions(analysis: Analysis, line: int, column: int) -> list[Span]:
    """Where what is at a place is defined: a name, an extended file, or a Python class."""
    occurrence = occurrence_at(analysis, line, column)
    if occurrence is not None:
        found = places_of(analysis, occurrence.symbol)
        return [each.span for each in found if each.is_definition]
    tree = analysis.written.get(str(analysis.path))
    place = place_at(tree, str(analysis.path), line, column) if tree is not None else None
    node = lookup(tree, place.path) if tree is not None and place is not None else None
    if place is None or place.is_key or not isinstance(node, ScalarNode):
        return []
    if place.path[0] == "extends":
        return [Span.of_file(_beside(analysis, node.text))]
    if place.path[-1] == "python":
        return list(_class_definition(analysis, node.text))
    return []


def references(
    analysis: Analysis, line: int, column: int, *, with_definition: bool
) -> list[Occurrence]:
    """Every place of the name at a place."""
    occurrence = occurrence_at(analysis, line, column)
    if occurrence is None:
        return []
    found = places_of(analysis, occurrence.symbol)
    return [each for each in found if with_definition or not each.is_definition]


def rename(analysis: Analysis, line: int, column: int, new_name: str) -> dict[Span, str]:
    """The new text of every place of the name at a place.

    Raises:
        RenameError: there is no name, the new one is not possible or taken, or a place cannot be
            edited.
    """
    occurrence = renamable(analysis, line, column)
    symbol = occurrence.symbol
    if symbol.kind != "topic":
        if not _NAME.match(new_name):
            raise RenameError(f"'{new_name}' is no name: use letters, digits and underscores")
        if places_of(analysis, Symbol(symbol.kind, new_name)):
            raise RenameError(f"there is already a {symbol.kind} '{new_name}'")
        return {each.span: new_name for each in places_of(analysis, symbol)}
    if not _TOPIC.match(new_name):
        raise RenameError(f"'{new_name}' is no topic: use letters, digits, underscores and '/'")
    full = expand(new_name, "", occurrence.namespace)
    if full != symbol.name and places_of(analysis, Symbol("topic", full)):
        raise RenameError(f"there is already a topic {full}")
    return {each.span: _as_written(each, full) for each in places_of(analysis, symbol)}


def renamable(analysis: Analysis, line: int, column: int) -> Occurrence:
    """The name at a place.

    Raises:
        RenameError: there is none, or one of its places cannot be edited.
    """
    occurrence = occurrence_at(analysis, line, column)
    if occurrence is None:
        raise RenameError("no name that can be changed is here")
    if occurrence.symbol.kind == "topic":
        _check_topic(analysis, occurrence.symbol)
    for each in places_of(analysis, occurrence.symbol):
        if each.span.file.startswith(("--", "$")):
            raise RenameError(f"'{each.text}' comes from an option or the environment")
    return occurrence


def _check_topic(analysis: Analysis, symbol: Symbol) -> None:
    places = {each.span for each in places_of(analysis, symbol)}
    context = analysis.context
    for phase in context.wiring.phases if context is not None else ():
        for end in (*phase.publishers(symbol.name), *phase.subscriptions(symbol.name)):
            if end.is_node and end.path[-2:-1] != ("remappings",):
                verb = "publishes" if end.is_publisher else "subscribes to"
                raise RenameError(
                    f"{end.owner} {verb} {symbol.name} by the name in its code",
                    hint="add a remapping to the node first",
                )
    if not places:
        raise RenameError(f"{symbol.name} is not written in the spec")


def _as_written(place: Occurrence, full: str) -> str:
    """The new name in the form of the old one: absolute, or relative to the same namespace."""
    inside = f"{place.namespace.rstrip('/')}/"
    if not place.text.startswith("/") and full.startswith(inside):
        return full.removeprefix(inside)
    return full


def _beside(analysis: Analysis, text: str) -> str:
    return posixpath.normpath(posixpath.join(analysis.path.parent.as_posix(), text))


def _class_definition(analysis: Analysis, text: str) -> Iterator[Span]:
    """The class of a Python node in a file next to the spec; the file is read, not imported."""
    target = python_target(text, analysis.path.parent)
    if target.module or not target.readable:
        return
    file = str(FilePath(posixpath.normpath(target.file.as_posix())))
    found = definitions_in(target.file)
    if found is None:
        return
    for each in found:
        if each.name == target.name:
            column = each.col_offset + 1
            yield Span(file, each.lineno, column, each.lineno, column + len(each.name))
            return
    yield Span.of_file(file)
