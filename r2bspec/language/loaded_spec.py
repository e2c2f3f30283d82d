"""What a file turned out to be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path as FilePath

from r2bspec.diagnostics import Diagnostic, Path, Span
from r2bspec.language.located_tree import ScalarNode, TreeNode, lookup, span_at, to_plain
from r2bspec.language.matrix import MatrixCase
from r2bspec.language.source_columns import inner_span
from r2bspec.language.source_text import Source
from r2bspec.language.spec import Spec
from r2bspec.language.value_origins import ValueOrigins


@dataclass(frozen=True, slots=True)
class LoadedSpec:
    """A document, or one case of it, as far as it could be understood.

    Attributes:
        file: the name of the file as the user gave it; spans in it use that name.
        base_dir: the folder to which paths in the document are relative.
        spec: the typed document; None if and only if there are errors.
        tree: the located document after substitution; None where the text is not YAML.
        diagnostics: all that was found, sorted by place.
        sources: the texts that spans point into, by file name: the file, what it extends, and
            options.
        used_variables: names of the variables that were substituted somewhere.
        matrix_case: which case of the matrix this is; None without a matrix.
        origins: how values got here that were written elsewhere.
    """

    file: str
    base_dir: FilePath
    spec: Spec | None
    tree: TreeNode | None
    diagnostics: tuple[Diagnostic, ...]
    sources: Mapping[str, Source] = field(repr=False)
    used_variables: frozenset[str] = frozenset()
    matrix_case: MatrixCase | None = field(default=None, repr=False)
    origins: ValueOrigins = field(default=ValueOrigins(), repr=False)

    @property
    def case(self) -> str:
        """Which case of the matrix this is, such as ``threads=2``; empty without a matrix."""
        return self.matrix_case.name if self.matrix_case is not None else ""

    @property
    def id(self) -> str:
        """The key of this case in results and baselines: ``name``, or ``name[threads=2]``."""
        name = self.spec.name if self.spec is not None else FilePath(self.file).name
        return f"{name}[{self.case}]" if self.case else name

    def span(self, path: Path, key: bool = False) -> Span:
        """Where the value at a path stands, or its key.

        Where there is no such value (a default, a key that is missing), the place is the key of
        the nearest ancestor that exists.
        """
        if self.tree is None:
            return Span.of_file(self.file)
        return span_at(self.tree, path, key=key)

    def span_inside(self, path: Path, offset: int, length: int = 1) -> Span:
        """The place of a piece of the text at a path, such as a metric in a requirement."""
        node = lookup(self.tree, path) if self.tree is not None else None
        if not isinstance(node, ScalarNode):
            return self.span(path)
        if node.origin is not None:
            return node.span
        source = self.sources.get(node.span.file)
        return inner_span(source, node.span, node.text, offset, length)

    @property
    def texts(self) -> dict[str, str]:
        """The texts of `sources`, as renderers of diagnostics want them."""
        return {name: source.text for name, source in self.sources.items()}

    def resolved_yaml(self) -> str:
        """The document as YAML: one case, with files, options, variables and merges written out."""
        from r2bspec.language.yaml_dump import to_yaml

        return to_yaml(to_plain(self.tree)) if self.tree is not None else ""
