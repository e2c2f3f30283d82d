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
from typing import NamedTuple

from msgspec.structs import replace

from r2bspec.diagnostics import Related
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
        folders = [folder.resolve() for folder in readable_folders(home, allowed)]
        chain = _Chain(document, folders, [home / FilePath(document.file).name])
        document.tree = chain.merge(root, document.file, ())


class _Chain(NamedTuple):
    """Files of which each extends the next.

    Attributes:
        document: the first of them.
        folders: where files may be read.
        files: the real paths of those met so far.
    """

    document: Document
    folders: list[FilePath]
    files: list[FilePath]

    def merge(self, root: tree.MapNode, file: str, trace: tuple[Related, ...]) -> tree.MapNode:
        """Return the map of a file over what it extends; `trace` are the places that led to it."""
        node = root.entries[KEY].value
        if not isinstance(node, tree.ScalarNode) or not isinstance(node.value, str):
            return root  # reported by the schema
        own = tree.without(root, KEY)
        folder = posixpath.dirname(file.replace(os.sep, "/"))
        below = posixpath.normpath(posixpath.join(folder, node.value))
        if problem := self._problem(node.value, FilePath(folder), below):
            self.document.problems.error(*problem[:2], node.span, problem[2], related=trace)
            self.document.is_incomplete = True
            return own
        trace = (Related(f"{quote(node.value)} is extended here", node.span), *trace)
        self.files.append(FilePath(below).resolve())
        self.document.origins.files.setdefault(below, trace)
        base = self._compose_file(node, below)
        if base is None:
            self.document.is_incomplete = True
            return own
        base = self.merge(base, below, trace) if KEY in base.entries else base
        moved = posixpath.dirname(posixpath.normpath(node.value))
        done = rebase_paths(base, language(), moved) if moved else base
        return overlay(done, own) if isinstance(done, tree.MapNode) else own

    def _problem(self, text: str, folder: FilePath, file: str) -> tuple[str, str, str] | None:
        """Return code, message and help if a file cannot be extended; None if it can be read."""
        if OPENING in text:
            help_text = "write the file name: files are merged before variables are known"
            return "R2B125", "references are not supported in 'extends'", help_text
        try:
            real = FilePath(file).resolve()
            there = is_regular(FilePath(file))
        except (OSError, ValueError, RuntimeError):
            real, there = self.folders[0], False
        # The configuration of a repository may have a token.
        if ".git" in real.parts or not any(real.is_relative_to(place) for place in self.folders):
            help_text = "copy it into that folder, or keep both in one work tree of git"
            return "R2B134", f"{quote(text)} is outside of the folder of this spec", help_text
        if not there:
            help_text = near_path(text, folder) or "paths are relative to this file"
            return "R2B133", f"file not found: {quote(text)}", help_text
        if real in self.files or len(self.files) > limits.MAX_EXTENDS_DEPTH:
            message = f"{quote(text)} extends itself, or the chain of files is too long"
            return "R2B135", message, "remove one 'extends' of this cycle"
        return None

    def _compose_file(self, node: tree.ScalarNode, file: str) -> tree.MapNode | None:
        source = read_file(FilePath(file), self.folders)
        self.document.sources[file] = source
        composed = compose(source)
        problems = self.document.problems
        problems.diagnostics += [
            problem for problem in composed.diagnostics if problem not in problems.diagnostics
        ]
        if isinstance(composed.tree, tree.MapNode):
            return composed.tree
        if composed.tree is not None:
            message = f"{quote(posixpath.basename(file))} cannot be extended: it is not a map"
            problems.error("R2B133", message, node.span, "the file needs the keys of a spec")
        return None
