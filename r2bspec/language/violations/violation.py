"""One violation of the schema, with everything that its explanation needs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from r2bspec.diagnostics import Diagnostic, Edit, Path, Related, Severity, Span, format_path
from r2bspec.language.located_tree import ScalarNode, TreeNode, lookup, span_at
from r2bspec.language.source_text import Source


@dataclass(frozen=True, slots=True)
class Violation:
    """A place in the document and the keyword of the schema that it violates.

    Attributes:
        path: of the value, or of the map whose key is wrong.
        keyword: of the schema, such as ``type``; ``propertyNames`` for a key of a wrong form.
        limit: the value of the keyword.
        value: the value as plain data; for ``propertyNames``, the key.
        schema: the part of the schema that `keyword` belongs to.
    """

    path: Path
    keyword: str
    limit: Any
    value: Any
    schema: dict[str, Any]
    root: TreeNode
    sources: Mapping[str, Source]

    @property
    def name(self) -> str:
        """The path as shown in messages."""
        return f"'{format_path(self.path)}'" if self.path else "the document"

    @property
    def node(self) -> TreeNode | None:
        """The located value."""
        return lookup(self.root, self.path)

    def error(
        self,
        code: str,
        message: str,
        help_text: str = "",
        *,
        span: Span | None = None,
        path: Path | None = None,
        repair: str = "",
        related: tuple[Related, ...] = (),
    ) -> Diagnostic:
        """A diagnostic at the value, or at `span`.

        `repair` becomes an edit of the value, unless the value comes from a variable: then the
        variable would have to be edited, which may be used elsewhere.
        """
        node = self.node
        place = span or span_at(self.root, self.path)
        edit = Edit(place, repair) if repair else None
        if span is None and isinstance(node, ScalarNode) and node.origin is not None:
            related += (node.origin,)
            edit = None
        return Diagnostic(
            code,
            Severity.ERROR,
            message,
            place,
            path=self.path if path is None else path,
            help=help_text,
            related=related,
            edit=edit,
        )
