"""Substitution of ``$(var x)`` and ``$(env X)`` in the located tree.

The rules:

- References are replaced in values, and in keys of maps whose keys are topics; not below unknown
  keys.
- A value that consists of one reference gets the type of the variable, unless it must be a string;
  in other text, the text of the variable is inserted.
- Values of `variables:` may refer to the environment, not to other variables: otherwise their
  order would matter, and cycles would be possible.
- Inside an entry with `repeat`, the variables of the instance shadow all others; the entry is
  expanded once per instance.
- ``$(env X)`` reads only variables that `environment:` lists, so that the file shows what it
  depends on. The text is read as an unquoted value, as with ``--var``.
- ``$(env X)`` is not replaced if X is a secret (`r2bspec.language.secrets`). Such a
  reference is allowed only where nothing but a process needs the value.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

from msgspec.structs import replace

from r2bspec.diagnostics import Certainty, Related, Span, did_you_mean
from r2bspec.diagnostics import Path as TreePath
from r2bspec.diagnostics.quote import quote, unknown_name_help
from r2bspec.language import variables
from r2bspec.language.declaration import ValueRule
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
    items_of,
    without,
)
from r2bspec.language.read_spec import INVALID, read_value
from r2bspec.language.secrets import is_secret_variable, secret_reference
from r2bspec.language.yaml_document import parse_unquoted
from r2bspec.safe_io.limits import MAX_DOCUMENT_BYTES, MAX_REFERENCES, MAX_YAML_EXPANDED_VALUES

_DECLARATIONS = frozenset({"variables", "environment", "r2bspec"})
_REPEAT = "repeat"


def substitute(
    root: MapNode,
    rule: ValueRule,
    sources: Mapping[str, Source],
    environ: Mapping[str, str],
    refused: frozenset[str] = frozenset(),
    inserted: int = 0,
) -> Substitution:
    """Replace every reference in a document; `rule` defines the known keys.

    Variables in `refused` have been reported, and have unknown values. The characters `inserted`
    in other cases of the document count for the limit.
    """
    work = Substitution(root, sources, environ, _sections(rule), refused)
    work.inserted = inserted
    entries = dict(root.entries)
    if work.variables is not None:
        entries["variables"] = replace(entries["variables"], value=work.variables)
    for key, entry in root.entries.items():
        if key not in _DECLARATIONS:
            entries[key] = replace(entry, value=work.walk(entry.value, rule.below(key)))
    work.tree = MapNode(entries, root.span)
    return work


@cache
def _sections(rule: ValueRule, path: TreePath = ()) -> dict[int, TreePath]:
    """The sections whose entries may have `repeat`, by the rule of the section."""
    if rule.values is not None and rule.values.below(_REPEAT) is not None:
        return {id(rule): path}
    return {
        name: place
        for key, below in (rule.keys or {}).items()
        for name, place in _sections(below, (*path, key)).items()
    }


class Substitution:
    """The tree after substitution, the problems, and the variables that were used.

    Attributes:
        origins: for each entry made by `repeat`, the place that names the instance.
    """

    def __init__(
        self,
        root: MapNode,
        sources: Mapping[str, Source],
        environ: Mapping[str, str],
        sections: Mapping[int, TreePath],
        refused: frozenset[str],
    ) -> None:
        self.tree: TreeNode = root
        self.problems = DiagnosticCollector()
        self.used: set[str] = set()
        self.variables: MapNode | None = None
        self._sources = sources
        self._environ = environ
        self._refused = refused
        self._allowed = {
            name: item.span for name, item in variables.listed_environment(root).items()
        }
        self.origins: dict[TreePath, tuple[Related, ...]] = {}
        self._sections = sections
        self._local: Mapping[str, TreeNode] = {}
        self._instance_origin: tuple[Related, ...] = ()
        self._repeated = 0
        self._done: dict[tuple[int, int, int], TreeNode] = {}
        self._keep_alive: list[object] = []  # so that no id is used twice
        self.inserted = self._references = 0
        self._size_exceeded = False
        self._in_declarations = True
        declared = child(root, "variables")
        if isinstance(declared, MapNode):
            self.variables = MapNode(
                {
                    key: replace(entry, value=self._declared(key, entry))
                    for key, entry in declared.entries.items()
                },
                declared.span,
            )
        self._in_declarations = False

    def _declared(self, name: str, entry: Entry) -> TreeNode:
        node = entry.value
        value = variables.declared_value(node)
        if isinstance(value, ScalarNode) and variables.OPENING in value.text:
            text = self._scalar(value)
            if isinstance(node, MapNode) and variables.restricts_value(node):
                text = self._without_secret(text)
            node = variables.with_value(node, text)
        if isinstance(node, MapNode):
            sound = variables.check_declaration(name, node, entry.key_span, self.problems)
            if value is not None and not sound:  # reported here, and not again where it is used
                return variables.with_value(node, UnknownNode(value.span))
        return node

    def walk(self, node: TreeNode, rule: ValueRule | None) -> TreeNode:
        """Substitute below a node with its rule; None is that of an unknown key."""
        if rule is None:
            return node
        if isinstance(node, ScalarNode):
            text = self._scalar(node)
            if not rule.about.deferrable:
                text = self._without_secret(text)
            if text is not node and rule.is_text and isinstance(text, ScalarNode):
                # A value that must be a string, also if the variable is a number.
                return replace(text, value=text.text)
            return text
        if isinstance(node, UnknownNode):
            return node
        name = (id(node), id(rule), id(self._local))
        if name not in self._done:
            if self._instance_origin:
                self._count(node)
            if isinstance(node, MapNode):
                self._done[name] = self._map(node, rule)
            else:
                items = tuple(self.walk(item, rule.items) for item in node.items)
                self._done[name] = ListNode(items, node.span)
        return self._done[name]

    def _map(self, node: MapNode, rule: ValueRule) -> MapNode:
        entries: dict[str, Entry] = {}
        section = self._sections.get(id(rule))
        for key, entry in node.entries.items():
            made = (
                self._instances(section, key, entry, rule.values) if section is not None else None
            )
            if made is not None:
                for name, instance in made.items():
                    if name in entries:
                        self._report_clash(name, instance.key_span, entries[name].key_span)
                    entries.setdefault(name, instance)
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

    def _instances(
        self, section: TreePath, key: str, entry: Entry, rule: ValueRule | None
    ) -> dict[str, Entry] | None:
        """The entries that `repeat` makes of one; None without it, or if the schema refuses it."""
        repeat = child(entry.value, _REPEAT)
        form = rule.below(_REPEAT) if rule is not None else None
        if not isinstance(entry.value, MapNode) or repeat is None or form is None:
            return None
        if read_value(repeat, form)[0] is INVALID:
            return None
        instances: dict[str, Entry] = {}
        repeated, outside = without(entry.value, _REPEAT), self._local
        for name, instance in entries_of(repeat).items():
            if self._repeated > MAX_YAML_EXPANDED_VALUES:
                break
            self._local = {
                variable: self._scalar(given.value)
                for variable, given in entries_of(instance.value).items()
                if isinstance(given.value, ScalarNode)
            }
            self._keep_alive.append((repeated, self._local))
            whole, place = f"{key}_{name}", instance.key_span
            self._instance_origin = (Related(f"the instance '{name}' of '{key}'", place),)
            self.origins[(*section, whole)] = self._instance_origin
            instances[whole] = Entry(place, self.walk(repeated, rule), entry.key_resolved)
            self._local, self._instance_origin = outside, ()
        return instances

    def _count(self, node: TreeNode) -> None:
        """Limit the size of the document that `repeat` makes."""
        before = self._repeated
        self._repeated += 1 + len(entries_of(node)) + len(items_of(node))
        if before <= MAX_YAML_EXPANDED_VALUES < self._repeated:
            message = f"'repeat' expands to more than {MAX_YAML_EXPANDED_VALUES:,} values"
            self.problems.error("R2B129", message, node.span, "use fewer instances")

    def _key(self, key: str, span: Span, *, topics: bool) -> tuple[str, bool]:
        if not topics:
            self.problems.error(
                "R2B125",
                "references are not supported in this key",
                span,
                "$(var ...) and $(env ...) are supported in values, and in keys that are topics",
            )
            return key, False
        text = self._without_secret(self._scalar(ScalarNode(key, key, span)))
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
        secret = ""
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
            if value.secret and not secret:
                secret, origin = value.secret, value.origin
            origin = origin or value.origin
            self.inserted += len(value.text)
            self._references += 1
            if self.inserted > MAX_DOCUMENT_BYTES or self._references > MAX_REFERENCES:
                if not self._size_exceeded:
                    message = (
                        f"there are more than {MAX_REFERENCES:,} references to variables"
                        if self._references > MAX_REFERENCES
                        else "after substitution the document, with all its cases, is larger than "
                        f"{MAX_DOCUMENT_BYTES // 1_000_000} MB"
                    )
                    self.problems.error("R2B129", message, node.span, "use shorter values")
                self._size_exceeded = failed = True
                break
            if is_whole and isinstance(reference, variables.Reference):
                return replace(value, span=node.span)
        if failed:
            return UnknownNode(node.span)
        parts.append(text[at:])
        joined = "".join(parts)
        return ScalarNode(joined, joined, node.span, '"', origin, secret)

    def _without_secret(self, node: ScalarNode | UnknownNode) -> ScalarNode | UnknownNode:
        """The node, or UnknownNode where it refers to a secret, which has no place here."""
        if not isinstance(node, ScalarNode) or not node.secret:
            return node
        self.problems.error(
            "R2B142",
            f"the value of {node.secret} is a secret, and cannot be used here",
            node.span,
            "secrets are allowed in 'env', 'parameters', 'arguments', commands and requests, which "
            "are read by processes only; rename the variable if it holds no secret",
            related=(node.origin,) if node.origin else (),
        )
        return UnknownNode(node.span)

    def _value(
        self, found: variables.Reference | variables.MalformedReference, node: ScalarNode
    ) -> ScalarNode | None:
        """The value of one reference, with its origin; None if it is unknown."""
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
        if name in self._local:
            local = self._local[name]
            if not isinstance(local, ScalarNode):
                return None
            return replace(local, origin=Related(f"'{name}' is set here", local.span))
        declared = self.variables.entries if self.variables is not None else {}
        if name not in declared:
            if not self.problems.full:
                span = self._inner(node, found.name_start, len(name))
                help_text = unknown_name_help(
                    name,
                    sorted({*declared, *self._local}),
                    "declared variables",
                    f"declare it: 'variables: {{{name}: ...}}' at the top of the document",
                )
                close = did_you_mean(name, declared)
                related = self._instance_origin
                if close:
                    place = declared[close].key_span
                    related = (*related, Related(f"'{close}' is declared here", place))
                message = f"unknown variable '{name}'"
                self.problems.error("R2B120", message, span, help_text, related=related)
            return None
        self.used.add(name)
        value = variables.declared_value(declared[name].value)
        # A list, a map or null: reported by the schema at the declaration, once.
        if not isinstance(value, ScalarNode) or value.value is None:
            return None
        return replace(value, origin=Related(f"'{name}' is set here", value.span))

    def _environment(self, found: variables.Reference, node: ScalarNode) -> ScalarNode | None:
        name = found.name
        if name not in self._allowed:
            span = self._inner(node, found.name_start, len(name))
            close = did_you_mean(name, self._allowed)
            self.problems.error(
                "R2B121",
                f"environment variable {name} is not listed under 'environment:'",
                span,
                f"did you mean {close}?" if close else f"add {name} to 'environment:'",
            )
            return None
        if name in self._refused:
            return None
        text = self._environ.get(name)
        if text is None:
            span = self._inner(node, found.name_start, len(name))
            self.problems.error(
                "R2B122",
                f"environment variable {name} is not set",
                span,
                f"set it, for example: export {name}=...",
                related=(Related("listed here", self._allowed[name]),),
                certainty=Certainty.ENVIRONMENT,
            )
            return None
        # A value that has a reference in it would be one wherever it is inserted.
        if is_secret_variable(name, text) or variables.OPENING in text:
            said = f"{name} is listed here; a process reads its value when it starts"
            origin = Related(said, self._allowed[name])
            reference = secret_reference(name)
            return ScalarNode(reference, reference, node.span, origin=origin, secret=name)
        origin = Related(f"{name} is {quote(text)} in the environment", self._allowed[name])
        return ScalarNode(parse_unquoted(text), text, node.span, origin=origin)

    def _inner(self, node: ScalarNode, offset: int, length: int) -> Span:
        if self.problems.full:
            return node.span
        source = self._sources.get(node.span.file)
        return inner_span(source, node.span, node.text, offset, length)


def _is_final(node: TreeNode) -> bool:
    """Whether a node is a single value without a reference, and no secret."""
    if type(node) is not ScalarNode or node.secret:
        return False
    return type(node.value) is not str or variables.OPENING not in node.value
