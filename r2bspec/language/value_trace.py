"""Where a value comes from: every place from its use back to where it is written."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from r2bspec.diagnostics import Path, Span, did_you_mean, format_path
from r2bspec.diagnostics.quote import clip, quote
from r2bspec.language import located_tree
from r2bspec.language.declaration import rule_at, unknown_step
from r2bspec.language.explain_violations import to_flow_yaml
from r2bspec.language.load_spec import LoadedSpec
from r2bspec.language.variables import parse_path

_MAX_VALUE_CHARS = 200


class UnknownPathError(ValueError):
    """A path that neither the document nor the language has.

    Attributes:
        hint: the likely intended name.
    """

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


@dataclass(frozen=True, slots=True)
class ProvenanceStep:
    """One place in the trace of a value; `span` is None for a default."""

    message: str
    span: Span | None = None


@dataclass(frozen=True, slots=True)
class Provenance:
    """A value, as YAML on one line, and its trace from its use back to where it is written."""

    path: Path
    value: str
    steps: tuple[ProvenanceStep, ...]

    def text(self) -> str:
        """The value and its trace, one step per line."""
        lines = [f"{format_path(self.path)} = {clip(self.value, _MAX_VALUE_CHARS)}"]
        for step in self.steps:
            place = f"{step.span.file}:{step.span.line}:{step.span.column}: " if step.span else ""
            lines.append(f"  {place}{step.message}")
        return "\n".join(lines) + "\n"


def provenance(loaded: LoadedSpec, text: str) -> Provenance:
    """The trace of the value at a path.

    Raises:
        UnknownPathError: neither the document nor the language has the path.
    """
    path = parse_path(text)
    if not path or loaded.tree is None:
        raise UnknownPathError(f"{quote(text)} is not a path", "for example: benchmark.duration")
    node = located_tree.lookup(loaded.tree, path)
    if node is None:
        return _default_provenance(loaded.tree, path, text)
    origins = loaded.origins.origins_of(path, node.span)
    origin_spans = {origin.span for origin in origins}
    steps = list(_source_steps(loaded, node))
    steps += [step for step in _alias_steps(loaded.tree, path) if step.span not in origin_spans]
    spans = {step.span for step in steps}
    steps += [
        ProvenanceStep(origin.message, origin.span)
        for origin in origins
        if origin.span not in spans
    ]
    return Provenance(path, to_flow_yaml(located_tree.to_plain(node)), tuple(steps))


def _source_steps(loaded: LoadedSpec, node: located_tree.TreeNode) -> Iterator[ProvenanceStep]:
    """The place of the value itself, and of the variable that it refers to."""
    source = loaded.sources.get(node.span.file)
    option = node.span.file.startswith("--")
    here = "given by this option" if option else "written here"
    if source is not None and node.span.line == node.span.end_line:
        raw = source.line(node.span.line)[node.span.column - 1 : node.span.end_column - 1]
        if isinstance(node, located_tree.ScalarNode) and node.origin is not None:
            here += f", as {clip(raw)}"
    yield ProvenanceStep(here, node.span)
    if isinstance(node, located_tree.ScalarNode) and node.origin is not None:
        yield ProvenanceStep(node.origin.message, node.origin.span)
        matrix_case, brought = loaded.matrix_case, node.origin.span
        if matrix_case is not None and any(v.span == brought for v in matrix_case.values.values()):
            yield ProvenanceStep(f"in the case {matrix_case.name} of the matrix", matrix_case.span)


def _alias_steps(root: located_tree.TreeNode, path: Path) -> Iterator[ProvenanceStep]:
    """Aliases and merge keys: what they bring is written outside of the value that contains it."""
    node: located_tree.TreeNode | None = root
    for part in path:
        owner, node = node, located_tree.child(node, part)
        if node is None:
            return
        if isinstance(owner, located_tree.MapNode):
            key = owner.entries[str(part)].key_span
            if _precedes(node.span, key):
                yield ProvenanceStep(f"an alias is the value of {quote(str(part))} here", key)
            elif key.file == owner.span.file and not _is_inside(key, owner.span):
                yield ProvenanceStep(f"{quote(str(part))} is merged from here", key)
        elif isinstance(owner, located_tree.ListNode) and not _is_inside(node.span, owner.span):
            yield ProvenanceStep("an alias is an item of this list", owner.span)


def _precedes(span: Span, other: Span) -> bool:
    return span.file == other.file and (span.line, span.column) < (other.line, other.column)


def _is_inside(span: Span, outer: Span) -> bool:
    start = (outer.line, outer.column)
    end = (outer.end_line, outer.end_column)
    return span.file == outer.file and start <= (span.line, span.column) <= end


def _default_provenance(root: located_tree.TreeNode, path: Path, text: str) -> Provenance:
    """The default of a key that the document does not have."""
    position = unknown_step(path)
    if position is not None:
        above, step = rule_at(path[:position]), str(path[position])
        close = did_you_mean(step, (above.keys if above is not None else None) or ())
        where = f"'{format_path(path[:position])}'" if position else "the document"
        hint = f"did you mean '{close}'?" if close else ""
        raise UnknownPathError(f"{where} has no {quote(step)}", hint)
    for length in range(1, len(path) + 1):
        owner = located_tree.lookup(root, path[:length])
        above = rule_at(path[: length - 1])
        if owner is None and above is not None and above.names is not None:
            raise UnknownPathError(f"the document has no {quote(format_path(path[:length]))}")
    rule = rule_at(path)
    if rule is not None and rule.shown_default is not None:
        return Provenance(
            path,
            to_flow_yaml(rule.shown_default),
            (ProvenanceStep("the default: the document does not set it"),),
        )
    return Provenance(
        path, "nothing", (ProvenanceStep(f"{quote(text)} is not set and has no default"),)
    )
