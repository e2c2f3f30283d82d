"""Variables: how they are declared, how a text refers to them, and values from the command line.

    variables:
      width: 1280                                  # a value
      rate: {type: rate, value: 30 Hz}

The value, whether from the file, ``--var`` or a case of the matrix, must be of the declared type.
A text refers to it with ``$(var width)``, and to a variable of the
environment with ``$(env NAME)``. What becomes of references is in `r2bspec.language.resolve`.

``--set a.b.c=v`` and ``--var x=v`` are sources of their own: a finding in one shows the option with
a caret. A value that begins with a bracket, a brace or a quote is read as YAML, any other as an
unquoted scalar.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Literal

import msgspec
from msgspec.structs import replace

from r2bspec.diagnostics import Path, Related, Span, format_path
from r2bspec.diagnostics.quote import quote, unknown_name_help
from r2bspec.language.declaration import rule_at
from r2bspec.language.document import DiagnosticCollector, Document, Source, has_errors, read_text
from r2bspec.language.located_tree import (
    Entry,
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    UnknownNode,
    child,
    entries_of,
    items_of,
    lookup,
    replace_at,
    text_of,
)
from r2bspec.language.quantities import QUANTITIES, QuantityError
from r2bspec.language.yaml_document import compose, parse_unquoted

if TYPE_CHECKING:
    from r2bspec.language.selected_spec import Variables


OPENING = "$("

_REFERENCE = re.compile(r"\$\(\s*(var|env)\s+([A-Za-z_][A-Za-z0-9_]*)\s*\)")
_UNPARSED_REFERENCE = re.compile(r"\$\([^()\s]*(?:\s+[^()]*)?\)?")


class Reference(msgspec.Struct, frozen=True):
    """A reference, at ``text[start:end]``; its name begins at `name_start`."""

    start: int
    end: int
    kind: Literal["var", "env"]
    name: str
    name_start: int


class MalformedReference(msgspec.Struct, frozen=True):
    """Text at ``text[start:end]`` that begins like a reference but is not one."""

    start: int
    end: int
    message: str
    help: str


def references(text: str) -> Iterator[Reference | MalformedReference]:
    """Return every reference in `text`: all that begins with ``$(``, from left to right."""
    at = text.find(OPENING)
    while at >= 0:
        match = _REFERENCE.match(text, at)
        if match is not None:
            kind: Literal["var", "env"] = "var" if match[1] == "var" else "env"
            yield Reference(at, match.end(), kind, match[2], match.start(2))
            at = text.find(OPENING, match.end())
        else:
            rough = _UNPARSED_REFERENCE.match(text, at)
            end = rough.end() if rough is not None else at + 2
            yield MalformedReference(at, end, *_why_malformed(text[at:end]))
            at = text.find(OPENING, end)


def _why_malformed(reference: str) -> tuple[str, str]:
    """Return what is wrong with a text that begins like a reference, and the fix."""
    if not reference.endswith(")"):
        return "unclosed '$('", "close it with ')'"
    word = reference[2:-1].strip().partition(" ")[0]
    if word in ("var", "env"):
        example = "$(var rate)" if word == "var" else "$(env HOME)"
        message = f"$({word} ...) needs one name of letters, digits and underscores"
        return message, f"for example: {example}"
    return (
        "unknown reference; only $(var name) and $(env NAME) are supported",
        "for computed values, let a script write the spec, or pass them with --var",
    )


_VALUE_KEYS = ("value", "default")
_PLAIN_TYPES: dict[str, tuple[str, tuple[type, ...]]] = {
    "string": ("a string", (str,)),
    "integer": ("an integer", (int,)),
    "number": ("a number", (int, float)),
    "boolean": ("a boolean", (bool,)),
}


def listed_environment(root: TreeNode) -> dict[str, ScalarNode]:
    """Return the environment variables that a document lists under `environment`, by name."""
    listed = items_of(child(root, "environment"))
    return {
        item.value: item
        for item in listed
        if isinstance(item, ScalarNode) and isinstance(item.value, str)
    }


def declared_value(declared: TreeNode) -> TreeNode | None:
    """Return the value of a variable, declared as a map or not; None if it has no value."""
    if not isinstance(declared, MapNode):
        return declared
    for key in _VALUE_KEYS:
        if key in declared.entries:
            return declared.entries[key].value
    return None


def with_value(declared: TreeNode, value: TreeNode) -> TreeNode:
    """Return the same declaration with another value."""
    if not isinstance(declared, MapNode):
        return value
    entries = {
        key: given_value for key, given_value in declared.entries.items() if key not in _VALUE_KEYS
    }
    return MapNode({**entries, "value": Entry(value.span, value)}, declared.span)


def with_variables(root: TreeNode, values: Mapping[str, TreeNode]) -> TreeNode:
    """Return the document with other values for the variables that it declares."""
    for name, entry in entries_of(child(root, "variables")).items():
        if name in values:
            root = replace_at(root, ("variables", name), with_value(entry.value, values[name]))
    return root


def is_declared_text(declared: TreeNode) -> bool:
    """Return True if a variable is declared as a string, so that 010 is a string."""
    return text_of(child(declared, "type")) == "string"


def check_declaration(
    name: str, declared: MapNode, span: Span, problems: DiagnosticCollector
) -> bool:
    """Report problems of the value of a declared variable; `span` is that of its name.

    Lists and maps, which are never valid, are reported by the schema.

    Returns:
        Whether the value is of the declared type.
    """
    given = [key for key in _VALUE_KEYS if key in declared.entries]
    if len(given) == 2:
        problems.error(
            "R2B118",
            f"'variables.{name}' has both 'value' and 'default'",
            declared.entries[given[1]].key_span,
            "keep one of them",
            related=(Related("the other key", declared.entries[given[0]].key_span),),
        )
        return True
    value = declared_value(declared)
    if value is None:
        message = f"variable {quote(name)} has no value"
        help_text = f"add 'value: ...', or set it with --var {name}=..."
        problems.error("R2B132", message, span, help_text)
        return True
    kind = child(declared, "type")
    if kind is None or not isinstance(value, ScalarNode) or value.value is None:
        return True  # a list, a map or null is reported by the schema
    message, help_text = _mismatch(value, text_of(kind))
    if not message:
        return True
    related = (Related("the declared type", kind.span), *((value.origin,) if value.origin else ()))
    message = f"variable {quote(name)}: {message}"
    problems.error("R2B130", message, value.span, help_text, related=related)
    return False


def _mismatch(node: ScalarNode, kind: str) -> tuple[str, str]:
    """Return why a value is not of a type, and the fix; two empty strings if it is."""
    if kind in _PLAIN_TYPES:
        accepted, types = _PLAIN_TYPES[kind]
        if type(node.value) in types:
            return "", ""
        help_text = (
            f'quote it: "{node.text}"'
            if kind == "string"
            else "change the value or the declared type"
        )
        return f"{quote(node.text)} is not {accepted}", help_text
    quantity = QUANTITIES.get(kind)
    if quantity is None:  # an unknown type, reported by the schema
        return "", ""
    if not isinstance(node.value, str):
        unit = next(iter(quantity.units))
        return f"{node.text} has no unit", f"write {node.text} {unit} if you mean that"
    try:
        quantity.parse(node.value)
    except QuantityError as error:
        return str(error), f"for example: {error.suggestion or quantity.example}"
    return "", ""


_PART = re.compile(r"\[(\d{1,9})\]|\['([^']*)'\]|(?:^|\.)([^.\[\]'=]+)")


class _Option(msgspec.Struct, frozen=True):
    """The text of an option, its path, and the offsets of each part and of the value."""

    source: Source
    path: Path = ()
    offsets: tuple[int, ...] = ()
    value_offset: int = 0

    @property
    def places(self) -> list[Span]:
        """The place of each part of the path."""
        parts = zip(self.offsets, self.path, strict=True)
        return [self.span(offset, offset + len(str(part))) for offset, part in parts]

    def span(self, start: int, end: int) -> Span:
        return Span(self.source.file, 1, start + 1, 1, max(end, start + 1) + 1)


def apply_overrides(document: Document, sets: Sequence[str], variables: Variables) -> None:
    """Apply `sets`, each ``path=value``, in their order, then `variables`."""
    for text in sets:
        _apply_set(document, text)
    for name, given in variables.items():
        shown = str(given).lower() if isinstance(given, bool) else str(given)
        _apply_variable(document, name, shown)


def parse_path(text: str) -> Path:
    """Return the path in a text such as ``data_loader.topics['/a']``.

    Empty if the text is not a path.
    """
    return _parse(f"{text}=").path


def _apply_set(document: Document, text: str) -> None:
    option = _parse(text)
    document.sources[option.source.file] = option.source
    if not option.path:
        document.problems.error(
            "R2B127",
            f"expected PATH=VALUE, found {quote(text)}",
            option.span(0, len(text)),
            "for example: --set benchmark.iterations=3",
        )
        return
    is_map = option.source.text[option.value_offset :].startswith("{")
    if (missing := missing_step(document.tree, option.path, sets_map=is_map)) is not None:
        position, help_text = missing
        wrong = format_path(option.path[: position + 1])
        message = f"the document has no '{wrong}' to replace"
        document.problems.error("R2B127", message, option.places[position], help_text)
        return
    value = _value(document, option)
    document.tree = replace_at(document.tree, option.path, value, option.places)


def missing_step(
    root: TreeNode | None, path: Path, *, sets_map: bool = False
) -> tuple[int, str] | None:
    """Return the index of the first step that a document lacks and that cannot be added.

    Args:
        root: the document.
        path: the path of a value to set.
        sets_map: whether that value is a map.

    Returns:
        The position, and what to write instead; None if the value can be set.
    """
    node = root
    for position, step in enumerate(path):
        above, below = path[: position + 1], child(node, step)
        whole = sets_map and above == path
        if below is None and not _can_add(node, above, sets_map=whole):
            return position, _path_suggestion(node, above)
        node = below
    return None


def _can_add(node: TreeNode | None, path: Path, *, sets_map: bool) -> bool:
    """Return whether a value that the document lacks can be set: a key of the language.

    A name that the user chooses, such as that of a node, is added only where its value has no keys
    of its own, as a parameter has none: a misspelt node must not become a second one. A container
    can be added with all of its keys, as in ``containers.vision={executable: python}``.

    Args:
        node: the parent; None if the document lacks it, too.
        path: the path of the value.
        sets_map: whether the value is a map.
    """
    # A key without a value, as in ``benchmark:``, is as good as a map.
    is_empty = isinstance(node, ScalarNode) and node.value is None
    if not (node is None or isinstance(node, MapNode) or is_empty):
        return False
    key = path[-1]
    if not isinstance(key, str) or key == "extends":
        return False
    parent = rule_at(path[:-1])
    if parent is None or "object" not in parent.kinds:
        return False
    if key in (parent.keys or ()) or (parent.values is not None and parent.values.keys is None):
        return True
    return sets_map and path[:-1] == ("containers",)


def _apply_variable(document: Document, name: str, text: str) -> None:
    source = Source(f"--var {name}", f"{name}={text}")
    option = _Option(source, ("variables", name), (0, 0), len(name) + 1)
    document.sources[source.file] = source
    root = document.tree
    if root is None:
        return
    if lookup(root, ("matrix", "axes", name)) is not None:
        document.problems.error(
            "R2B128",
            f"{quote(name)} is an axis of the matrix: its value depends on the case",
            option.span(0, len(name)),
            "select a case with --case, or replace the axis: "
            + quote(f"--set matrix.axes.{name}=[{text}]"),
        )
        return
    known = entries_of(child(root, "variables"))
    if name not in known:
        if_none = "the document declares no variables"
        help_text = unknown_name_help(name, sorted(known), "declared variables", if_none)
        message = f"unknown variable {quote(name)}"
        document.problems.error("R2B128", message, option.span(0, len(name)), help_text)
        return
    value = _value(document, option)
    if is_declared_text(known[name].value) and isinstance(value, ScalarNode):
        value = ScalarNode(text, text, value.span, '"')
    document.tree = with_variables(root, {name: value})


def _parse(text: str) -> _Option:
    path: list[str | int] = []
    offsets: list[int] = []
    at = 0
    while at < len(text) and text[at] != "=":
        match = _PART.match(text, at)
        if match is None:
            return _Option(Source("--set", text))
        index, quoted, name = match.groups()
        path.append(int(index) if index is not None else quoted if quoted is not None else name)
        offsets.append(match.start(match.lastindex or 0))
        at = match.end()
    if at >= len(text):
        return _Option(Source("--set", text))
    source = Source(f"--set {text[:at]}", text)
    return _Option(source, tuple(path), tuple(offsets), at + 1)


def _value(document: Document, option: _Option) -> TreeNode:
    text = option.source.text[option.value_offset :]
    span = option.span(option.value_offset, len(option.source.text))
    if text[:1] not in ("[", "{", "'", '"'):
        problems = read_text(text, option.source.file).diagnostics
        if not has_errors(problems):
            return ScalarNode(parse_unquoted(text), text, span)
        document.problems.diagnostics += [replace(problem, span=span) for problem in problems]
        return UnknownNode(span)
    # Spaces in place of the path keep the columns.
    composed = compose(read_text(" " * option.value_offset + text, option.source.file))
    document.problems.diagnostics += composed.diagnostics
    return composed.tree or UnknownNode(span)


def _path_suggestion(node: TreeNode | None, path: Path) -> str:
    """Return what to write instead of the last part of a path."""
    if isinstance(node, ListNode):
        return f"the list has {len(node.items)} items, the first is [0]"
    parent = rule_at(path[:-1])
    written = list(entries_of(node))
    of_language = parent.keys or () if parent is not None and (node is None or written) else ()
    keys = list(dict.fromkeys([*written, *of_language]))
    if keys:
        return unknown_name_help(str(path[-1]), keys, "known keys")
    return "only values that the document has, or keys of the language, can be set"
