"""Files, recordings, classes and packages of this machine that can be written."""

from __future__ import annotations

import ast
import os
from collections.abc import Iterator, Sequence
from pathlib import Path as FilePath
from typing import Final

from lsprotocol import types

from r2bspec.check.installed_packages import (
    ament_packages,
    package_executables,
    package_plugins,
    package_share,
)
from r2bspec.language.bag_formats import BAG_FORMATS
from r2bspec.language.located_tree import ScalarNode, lookup
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.cursor_context import CursorContext
from r2bspec.language_server.proposals import Proposal
from r2bspec.language_server.python_files import definitions_in

_MAX_FILES: Final = 200


def recordings(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """Datasets, and the recordings below the folder of the spec."""
    from r2bspec.bags.errors import DataError
    from r2bspec.datasets.locate_bag import known_datasets

    try:
        for name in known_datasets():
            yield Proposal(name, "dataset", kind=types.CompletionItemKind.Module, order=5)
    except DataError:
        pass
    suffixes = tuple(each.suffix for each in BAG_FORMATS)
    yield from _files(analysis, context, suffixes, bags=True)


def yaml_files(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """YAML files, and the folders in which others may be."""
    yield from _files(analysis, context, (".yaml", ".yml"))


def any_file(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """Files and folders."""
    yield from _files(analysis, context, ())


def _files(
    analysis: Analysis, context: CursorContext, suffixes: Sequence[str], *, bags: bool = False
) -> Iterator[Proposal]:
    """Files and folders below the folder of the spec; with suffixes, only files that have one."""
    written = context.before.rpartition("/")[0]
    home = analysis.path.parent
    folder = home / written
    try:
        if not folder.resolve().is_relative_to(home.resolve()):
            return
        entries = sorted(os.scandir(folder), key=lambda each: each.name)[:_MAX_FILES]
    except (OSError, ValueError):
        return
    for each in entries:
        if each.name.startswith((".", "__")) or each.name == analysis.path.name:
            continue
        is_folder = each.is_dir()
        if is_folder or not suffixes or FilePath(each.name).suffix in suffixes:
            kind = types.CompletionItemKind.Folder if is_folder else types.CompletionItemKind.File
            name = f"{written}/{each.name}" if written else each.name
            if is_folder and bags and (FilePath(each.path) / "metadata.yaml").is_file():
                # With './' before it, it is not taken for the name of a dataset.
                name = name if written else f"./{name}"
                yield Proposal(name, "recording", kind=types.CompletionItemKind.Module, order=1)
            else:
                yield Proposal(name, kind=kind, order=400)


def python_classes(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The reference nodes, and the classes in Python files next to the spec, without imports."""
    from r2bspec.wiring.node_interface import reference_node_interfaces

    del context
    for name in reference_node_interfaces():
        yield Proposal(name, "reference node", kind=types.CompletionItemKind.Class, order=300)
    home = analysis.path.parent
    files = [*sorted(home.glob("*.py")), *sorted(home.glob("nodes/*.py"))][:_MAX_FILES]
    for file in files:
        place = f"./{file.relative_to(home).as_posix()}"
        classes = (each for each in definitions_in(file) or () if isinstance(each, ast.ClassDef))
        for each in classes:
            yield Proposal(f"{place}:{each.name}", kind=types.CompletionItemKind.Class, order=5)


def packages(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The packages that are installed, and those of the catalogue."""
    from r2bspec.wiring.node_interface import catalogue_packages

    del analysis, context
    installed = ament_packages()
    for name in sorted(installed):
        yield Proposal(name, "installed", kind=types.CompletionItemKind.Module, order=10)
    for name in sorted(set(catalogue_packages()) - installed):
        yield Proposal(name, "known", kind=types.CompletionItemKind.Module, order=20)


def plugins(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The composable nodes of the package that the node names."""
    from r2bspec.wiring.node_interface import catalogue_nodes

    package = _package_beside(analysis, context)
    installed = package_plugins(package)
    for name in sorted({*catalogue_nodes(package), *installed} - {""}):
        detail = "installed" if name in installed else "known"
        yield Proposal(name, detail, kind=types.CompletionItemKind.Class, order=5)


def executables(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The executables of the package that the node names."""
    from r2bspec.wiring.node_interface import catalogue_nodes

    package = _package_beside(analysis, context)
    installed = package_executables(package)
    known = {each.executable for each in catalogue_nodes(package).values() if each.executable}
    for name in sorted({*known, *installed}):
        detail = "installed" if name in installed else "known"
        yield Proposal(name, detail, kind=types.CompletionItemKind.File, order=5)


def launch_files(analysis: Analysis, context: CursorContext) -> Iterator[Proposal]:
    """The launch files of the package that the node names."""
    share = package_share(_package_beside(analysis, context))
    folder = share / "launch" if share is not None else None
    for each in sorted(folder.iterdir() if folder is not None and folder.is_dir() else ()):
        if "launch" in each.name:
            name = f"launch/{each.name}"
            yield Proposal(name, "installed", kind=types.CompletionItemKind.File, order=5)


def _package_beside(analysis: Analysis, context: CursorContext) -> str:
    tree = analysis.loaded.tree
    package = lookup(tree, (*context.path[:-1], "package")) if tree is not None else None
    return package.text if isinstance(package, ScalarNode) else ""
