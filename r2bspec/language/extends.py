"""`extends`: the file that a document extends, which may extend another.

Nested maps are merged, other values replaced, and null removes a key.

Only files of the folder of the spec and of its work tree are read. A path is relative to the file
in which it is written, and is rewritten where that is another folder; arguments of command lines
are not: which of them are paths is unknown.
"""

from __future__ import annotations

import os
import posixpath
from collections.abc import Iterable
from pathlib import Path as FilePath

from msgspec.structs import replace

from r2bspec.diagnostics import Related, Span
from r2bspec.diagnostics.quote import quote
from r2bspec.language import located_tree as tree
from r2bspec.language.declaration import ValueRule, language
from r2bspec.language.document import Document, read_file, readable_folders
from r2bspec.language.variables import OPENING
from r2bspec.language.yaml_document import compose
from r2bspec.safe_io import limits
from r2bspec.safe_io.file_search import near_path
from r2bspec.safe_io.safe_file import is_regular


def overlay(base: tree.MapNode, own: tree.MapNode) -> tree.MapNode:
    """Merge `own` over `base`; every value keeps the place where it is written.

    The keys of `base` come first, then the new keys. A null for a key that `base` does not have is
    kept, so that it is reported like any key without a value.
    """
    entries = dict(base.entries)
    for key, entry in own.entries.items():
        below = entries.get(key)
        if below is None:
            entries[key] = entry
        elif isinstance(entry.value, tree.ScalarNode) and entry.value.value is None:
            del entries[key]
        elif isinstance(entry.value, tree.MapNode) and isinstance(below.value, tree.MapNode):
            entries[key] = entry.with_value(overlay(below.value, entry.value))
        else:
            entries[key] = entry
    return tree.MapNode(entries, own.span)


def rebase_paths(node: tree.TreeNode, rule: ValueRule | None, folder: str) -> tree.TreeNode:
    """Return the tree with `folder` put before every relative path; `rule` is that of the node."""
    if rule is None:
        return node
    if isinstance(node, tree.ScalarNode):
        return _scalar(node, folder) if rule.about.path else node
    if isinstance(node, tree.ListNode):
        items = tuple(rebase_paths(item, rule.items, folder) for item in node.items)
        return tree.ListNode(items, node.span)
    if isinstance(node, tree.MapNode):
        return tree.MapNode(
            {
                key: entry.with_value(rebase_paths(entry.value, rule.below(key), folder))
                for key, entry in node.entries.items()
            },
            node.span,
        )
    return node


def _scalar(node: tree.ScalarNode, folder: str) -> tree.ScalarNode:
    text = node.value
    if not isinstance(text, str) or not text or text.startswith(("/", OPENING)):
        return node
    # A single word may be the name of a dataset or of a module; a path begins with './'.
    if not text.startswith(".") and "/" not in text and not text.endswith((".yaml", ".yml")):
        return node
    if ":" in text and ".py:" not in text:
        return node
    moved = posixpath.normpath(posixpath.join(folder, text))
    if not moved.startswith((".", "/")):
        moved = f"./{moved}"
    return replace(node, value=moved, text=moved)


KEY = "extends"


def extend_files(document: Document, allowed: Iterable[FilePath] = ()) -> None:
    """Merge the file that a document extends; without `extends`, its tree is unchanged."""
    root = document.tree
    if isinstance(root, tree.MapNode) and KEY in root.entries:
        home = document.base_dir.resolve()
        chain = _Chain(document, home, tuple(allowed), [home / FilePath(document.file).name])
        document.tree = chain.merge(root, document.file, ())


class _Chain:
    """Files of which each extends the next; `files` are the real paths of those met so far."""

    def __init__(
        self,
        document: Document,
        home: FilePath,
        allowed: tuple[FilePath, ...],
        files: list[FilePath],
    ) -> None:
        self._document = document
        self._home = home
        self._problems = document.problems
        self._allowed = allowed
        self._files = files

    def merge(self, root: tree.MapNode, file: str, trace: tuple[Related, ...]) -> tree.MapNode:
        """Return the map of a file over what it extends; `trace` are the places that led to it."""
        node = root.entries[KEY].value
        if not isinstance(node, tree.ScalarNode) or not isinstance(node.value, str):
            return root  # reported by the schema
        own = tree.without(root, KEY)
        base = self._base(node, node.value, file, trace)
        if base is None:
            self._document.is_incomplete = True
            return own
        return overlay(base, own)

    def _base(
        self, node: tree.ScalarNode, text: str, extending: str, trace: tuple[Related, ...]
    ) -> tree.MapNode | None:
        if OPENING in text:
            self._problems.error(
                "R2B125",
                "references are not supported in 'extends'",
                node.span,
                "write the file name: files are merged before variables are known",
            )
            return None
        folder = posixpath.dirname(extending.replace(os.sep, "/"))
        file = posixpath.normpath(posixpath.join(folder, text))
        real = self._readable_path(node, FilePath(folder), text)
        if real is None:
            return None
        if real in self._files:
            message, help_text = (
                f"{quote(text)} extends itself",
                "remove one 'extends' of this cycle",
            )
            self._problems.error("R2B135", message, node.span, help_text, related=trace)
            return None
        trace = (Related(f"{quote(text)} is extended here", node.span), *trace)
        if len(self._files) > limits.MAX_EXTENDS_DEPTH:
            message = f"'extends' reads more than {limits.MAX_EXTENDS_DEPTH} levels"
            self._problems.error("R2B135", message, node.span, "merge some files", related=trace)
            return None
        self._files.append(real)
        self._document.origins.files.setdefault(file, trace)
        below = self._compose_file(node, file)
        if below is None:
            return None
        whole = self.merge(below, file, trace) if KEY in below.entries else below
        moved = posixpath.dirname(posixpath.normpath(text))
        done = rebase_paths(whole, language(), moved) if moved else whole
        return done if isinstance(done, tree.MapNode) else None

    def _readable_path(self, node: tree.ScalarNode, folder: FilePath, text: str) -> FilePath | None:
        """Return the real path of a file that may be read.

        None if the reason why not is reported.
        """
        path = FilePath(os.path.normpath(folder / text))
        try:
            real = path.resolve()
            # The configuration of a repository may have a token.
            inside = ".git" not in real.parts and any(
                real.is_relative_to(folder.resolve())
                for folder in readable_folders(self._home, self._allowed)
            )
            there = inside and is_regular(path)
        except (OSError, ValueError, RuntimeError):
            inside, there, real = True, False, path
        if not inside:
            self._problems.error(
                "R2B134",
                f"{quote(text)} is outside of the folder of this spec",
                node.span,
                "copy it into that folder, or keep both in one work tree of git",
            )
        elif not there:
            message = f"file not found: {quote(text)}"
            help_text = near_path(text, folder) or "paths are relative to this file"
            self._problems.error("R2B133", message, node.span, help_text)
        else:
            return real
        return None

    def _compose_file(self, node: tree.ScalarNode, file: str) -> tree.MapNode | None:
        source = read_file(FilePath(file), self._allowed)
        self._document.sources[file] = source
        composed = compose(source)
        self._problems.diagnostics += [
            problem for problem in composed.diagnostics if problem not in self._problems.diagnostics
        ]
        if isinstance(composed.tree, tree.MapNode):
            return composed.tree
        if composed.tree is not None:
            self._problems.error(
                "R2B133",
                f"{quote(posixpath.basename(file))} cannot be extended: it is not a map",
                node.span,
                "the file needs the keys of a spec",
                related=(Related("the content of the file", Span.of_file(file)),),
            )
        return None
