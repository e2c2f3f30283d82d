"""The resolve pass: a case of a document, without references, notes and its matrix.

The rules:

- References ``$(var x)`` and ``$(env X)`` are replaced in values, and in keys of maps whose keys
  are topics; not below unknown keys.
- A value that consists of one reference gets the type of the variable, unless it must be a string;
  in other text, the text of the variable is inserted.
- Values of `variables:` may refer to the environment, not to other variables: otherwise their
  order would matter, and cycles would be possible. A case of the matrix replaces them.
- ``$(env X)`` reads only variables that `environment:` lists, so that the file shows what it
  depends on. The text is read as an unquoted value, as with ``--var``.
- ``$(env X)`` is refused if X is the name of a secret (`r2bspec.language.secrets`): its value would
  be written into plans and records.
- ``x-`` keys are notes in maps whose keys the language defines, and are dropped.
"""

from __future__ import annotations

from collections.abc import Mapping

from msgspec.structs import replace

from r2bspec.diagnostics import Certainty, Related, Span, did_you_mean
from r2bspec.diagnostics.quote import quote, unknown_name_help
from r2bspec.language import variables
from r2bspec.language.declaration import ValueRule, language
from r2bspec.language.document import DiagnosticCollector, Source, inner_span
from r2bspec.language.located_tree import (
    Entry,
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    UnknownNode,
    child,
    entries_of,
)
from r2bspec.language.secrets import is_secret_variable
from r2bspec.language.yaml_document import parse_unquoted

_AS_WRITTEN = frozenset({"environment", "r2bspec"})
_MATRIX = "matrix"


class Resolver:
    """A case of a document: its resolved tree, its problems, and the variables that it uses.

    Args:
        root: the document.
        sources: the texts that its places point into.
        environ: the environment for ``$(env X)``.
        case: the values of variables in this case.
    """

    def __init__(
        self,
        root: MapNode,
        sources: Mapping[str, Source],
        environ: Mapping[str, str],
        case: Mapping[str, TreeNode],
    ) -> None:
        self.problems = DiagnosticCollector()
        self.used: set[str] = set()
        self._sources = sources
        self._environ = environ
        self._allowed = {
            name: item.span for name, item in variables.listed_environment(root).items()
        }
        self._done: dict[tuple[int, int], TreeNode] = {}
        self._variables: dict[str, Entry] = {}
        self._in_declarations = True
        for name, entry in entries_of(child(root, "variables")).items():
            node = entry.value
            if name in case:
                node = variables.with_value(node, case[name])
            self._variables[name] = entry.with_value(self._declared(name, entry.key_span, node))
        self._in_declarations = False
        self.tree = self._document(root)

    def _document(self, root: MapNode) -> MapNode:
        rule = language()
        entries: dict[str, Entry] = {}
        for key, entry in root.entries.items():
            if key == "variables" and isinstance(entry.value, MapNode):
                entries[key] = entry.with_value(MapNode(self._variables, entry.value.span))
            elif key in _AS_WRITTEN:
                entries[key] = entry
            elif key != _MATRIX and not key.startswith("x-"):
                entries[key] = entry.with_value(self.walk(entry.value, rule.below(key)))
        return MapNode(entries, root.span)

    def _declared(self, name: str, key_span: Span, node: TreeNode) -> TreeNode:
        value = variables.declared_value(node)
        if isinstance(value, ScalarNode) and variables.OPENING in value.text:
            node = variables.with_value(node, self._scalar(value))
        if isinstance(node, MapNode):
            sound = variables.check_declaration(name, node, key_span, self.problems)
            if value is not None and not sound:  # reported here, and not again where it is used
                return variables.with_value(node, UnknownNode(value.span))
        return node

    def walk(self, node: TreeNode, rule: ValueRule | None) -> TreeNode:
        """Substitute below a node with its rule; the rule is None for an unknown key."""
        if rule is None:
            return node
        if isinstance(node, ScalarNode):
            text = self._scalar(node)
            if text is not node and rule.is_text and isinstance(text, ScalarNode):
                # A value that must be a string, also if the variable is a number.
                return replace(text, value=text.text)
            return text
        if isinstance(node, UnknownNode):
            return node
        name = (id(node), id(rule))
        if name not in self._done:
            if isinstance(node, MapNode):
                self._done[name] = self._map(node, rule)
            else:
                items = tuple(self.walk(item, rule.items) for item in node.items)
                self._done[name] = ListNode(items, node.span)
        return self._done[name]

    def _map(self, node: MapNode, rule: ValueRule) -> MapNode:
        entries: dict[str, Entry] = {}
        for key, entry in node.entries.items():
            if rule.keys is not None and key.startswith("x-"):
                continue
            if _is_final(entry.value) and variables.OPENING not in key and key not in entries:
                # Most entries.
                entries[key] = entry
                continue
            value = self.walk(entry.value, rule.below(key))
            new, sure = (key, True)
            if variables.OPENING in key:
                new, sure = self._key(key, entry.key_span, topics=rule.about.topics)
            if new in entries:
                self._report_clash(new, entry.key_span, entries[new].key_span)
                continue
            entries[new] = Entry(entry.key_span, value, key_resolved=sure and entry.key_resolved)
        return MapNode(entries, node.span)

    def _key(self, key: str, span: Span, *, topics: bool) -> tuple[str, bool]:
        if not topics:
            self.problems.error(
                "R2B125",
                "references are not supported in this key",
                span,
                "$(var ...) and $(env ...) are supported in values, and in keys that are topics",
            )
            return key, False
        text = self._scalar(ScalarNode(key, key, span))
        return (text.text, True) if isinstance(text, ScalarNode) else (key, False)

    def _report_clash(self, key: str, span: Span, first: Span) -> None:
        self.problems.error(
            "R2B126",
            f"duplicate key {quote(key)} after substitution",
            span,
            "rename one of them",
            related=(Related("first used here", first),),
        )

    def _scalar(self, node: ScalarNode) -> ScalarNode | UnknownNode:
        """Replace the references in a value; UnknownNode if one of them is unknown."""
        text = node.value
        if not isinstance(text, str) or variables.OPENING not in text:
            return node
        parts: list[str] = []
        at = 0
        failed = False
        origin: Related | None = None
        for reference in variables.references(text):
            value = self._value(reference, node)
            if value is None:
                failed = True
                if self.problems.full:
                    break
                continue
            is_whole = (reference.start, reference.end) == (0, len(text))
            parts += [text[at : reference.start], value.text]
            at = reference.end
            origin = origin or value.origin
            if is_whole and isinstance(reference, variables.Reference):
                return replace(value, span=node.span)
        if failed:
            return UnknownNode(node.span)
        parts.append(text[at:])
        joined = "".join(parts)
        return ScalarNode(joined, joined, node.span, '"', origin)

    def _value(
        self, found: variables.Reference | variables.MalformedReference, node: ScalarNode
    ) -> ScalarNode | None:
        """Return the value of one reference, with its origin; None if it is unknown."""
        if isinstance(found, variables.MalformedReference):
            span = self._inner(node, found.start, found.end - found.start)
            self.problems.error("R2B123", found.message, span, found.help)
            return None
        if found.kind == "env":
            return self._environment(found, node)
        if self._in_declarations:
            self.problems.error(
                "R2B124",
                "a variable cannot refer to another variable",
                self._inner(node, found.start, found.end - found.start),
                "write the value here, or combine both variables where they are used",
            )
            return None
        return self._variable(found, node)

    def _variable(self, found: variables.Reference, node: ScalarNode) -> ScalarNode | None:
        name = found.name
        declared = self._variables
        if name not in declared:
            if not self.problems.full:
                span = self._inner(node, found.name_start, len(name))
                help_text = unknown_name_help(
                    name,
                    sorted(declared),
                    "declared variables",
                    f"declare it: 'variables: {{{name}: ...}}' at the top of the document",
                )
                self.problems.error("R2B120", f"unknown variable '{name}'", span, help_text)
            return None
        self.used.add(name)
        value = variables.declared_value(declared[name].value)
        # A list, a map or null: reported by the schema at the declaration, once.
        if not isinstance(value, ScalarNode) or value.value is None:
            return None
        return replace(value, origin=Related(f"'{name}' is set here", value.span))

    def _environment(self, found: variables.Reference, node: ScalarNode) -> ScalarNode | None:
        name = found.name
        span = self._inner(node, found.name_start, len(name))
        if name not in self._allowed:
            close = did_you_mean(name, self._allowed)
            self.problems.error(
                "R2B121",
                f"environment variable {name} is not listed under 'environment:'",
                span,
                f"did you mean {close}?" if close else f"add {name} to 'environment:'",
            )
            return None
        if is_secret_variable(name):
            self.problems.error(
                "R2B142",
                f"the value of {name} is a secret, and would be written into the plan and the "
                "record",
                span,
                "let the node read the variable itself: what 'environment' lists reaches every "
                "process of the run",
            )
            return None
        text = self._environ.get(name)
        if text is None:
            self.problems.error(
                "R2B122",
                f"environment variable {name} is not set",
                span,
                f"set it, for example: export {name}=...",
                related=(Related("listed here", self._allowed[name]),),
                certainty=Certainty.ENVIRONMENT,
            )
            return None
        origin = Related(f"{name} is {quote(text)} in the environment", self._allowed[name])
        return ScalarNode(parse_unquoted(text), text, node.span, origin=origin)

    def _inner(self, node: ScalarNode, offset: int, length: int) -> Span:
        if self.problems.full:
            return node.span
        source = self._sources.get(node.span.file)
        return inner_span(source, node.span, node.text, offset, length)


def _is_final(node: TreeNode) -> bool:
    """Return whether a node is a single value without a reference."""
    if type(node) is not ScalarNode:
        return False
    return type(node.value) is not str or variables.OPENING not in node.value
