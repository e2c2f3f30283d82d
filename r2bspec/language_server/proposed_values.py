"""Values that do not come from the spec: files and packages of this machine, and requirements.

In a requirement or a quantity, it proposes metrics, operators, bounds and units.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Final

from lsprotocol import types

from r2bspec.bags.recording import DataError
from r2bspec.datasets.catalogue import known_datasets
from r2bspec.judge.measure.metric import Scope
from r2bspec.judge.measure.metric_catalogue import NO_SUBJECTS, MetricError, find_metric, names
from r2bspec.language.declaration import ValueRule
from r2bspec.language.located_tree import ScalarNode, lookup
from r2bspec.language.quantities import QUANTITIES, Duration, Quantity
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.positions import CompletionProposal, CursorContext
from r2bspec.language_server.symbols import names_of
from r2bspec.plan import installed_packages
from r2bspec.plan.wiring.node_interface import (
    catalogue_nodes,
    catalogue_packages,
    reference_node_interfaces,
)
from r2bspec.plan.wiring.python_files import read_python_file

_MAX_FILES: Final = 200


def recordings(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield datasets, and the recordings in the folder of the spec."""
    home = analysis.path.parent
    for metadata in sorted(home.glob("*/metadata.yaml"))[:_MAX_FILES]:
        # With './' before it, it is not taken for the name of a dataset.
        name = f"./{metadata.parent.name}"
        yield CompletionProposal(name, "recording", kind=types.CompletionItemKind.Module, order=1)
    try:
        for name in known_datasets():
            yield CompletionProposal(name, "dataset", kind=types.CompletionItemKind.Module, order=5)
    except DataError:
        pass


def python_classes(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the reference nodes, and the classes in Python files next to the spec."""
    for name in reference_node_interfaces():
        yield CompletionProposal(
            name, "reference node", kind=types.CompletionItemKind.Class, order=300
        )
    home = analysis.path.parent
    files = [*sorted(home.glob("*.py")), *sorted(home.glob("nodes/*.py"))][:_MAX_FILES]
    for file in files:
        place = f"./{file.relative_to(home).as_posix()}"
        module = read_python_file(file)
        for node in module.body if module is not None else ():
            if isinstance(node, ast.ClassDef):
                yield CompletionProposal(
                    f"{place}:{node.name}", kind=types.CompletionItemKind.Class, order=5
                )


def packages(_analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the packages that are installed, and those of the catalogue."""
    installed = installed_packages.ament_packages()
    for name in sorted(installed):
        yield CompletionProposal(name, "installed", kind=types.CompletionItemKind.Module, order=10)
    for name in sorted(set(catalogue_packages()) - installed):
        yield CompletionProposal(name, "known", kind=types.CompletionItemKind.Module, order=20)


def plugins(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the composable nodes of the package that the node names."""
    package = _package_beside(analysis, context)
    installed = installed_packages.package_plugins(package)
    yield from _installed_first(installed, catalogue_nodes(package), types.CompletionItemKind.Class)


def executables(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the executables of the package that the node names."""
    package = _package_beside(analysis, context)
    installed = installed_packages.package_executables(package)
    known = [node.executable for node in catalogue_nodes(package).values()]
    yield from _installed_first(installed, known, types.CompletionItemKind.File)


def _installed_first(
    installed: Collection[str], known: Iterable[str], kind: types.CompletionItemKind
) -> Iterator[CompletionProposal]:
    for name in sorted({*known, *installed} - {""}):
        detail = "installed" if name in installed else "known"
        yield CompletionProposal(name, detail, kind=kind, order=5)


def launch_files(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the launch files of the package that the node names."""
    share = installed_packages.package_share(_package_beside(analysis, context))
    folder = share / "launch" if share is not None else None
    for path in sorted(folder.iterdir() if folder is not None and folder.is_dir() else ()):
        if "launch" in path.name:
            name = f"launch/{path.name}"
            yield CompletionProposal(name, "installed", kind=types.CompletionItemKind.File, order=5)


def _package_beside(analysis: Analysis, context: CursorContext) -> str:
    tree = analysis.loaded.tree
    package = lookup(tree, (*context.path[:-1], "package"))
    return package.text if isinstance(package, ScalarNode) else ""


_OPERATORS: Final = ("<", "<=", ">", ">=", "==", "!=")
_NUMBER: Final = re.compile(r"\d+(?:\.\d*)?\Z")
_QUANTITIES: Final[Mapping[str, type[Quantity]]] = QUANTITIES | {"time": Duration}
"""The quantities by their names, and by the dimensions of metrics."""
_SPELLINGS: Final = frozenset({"µs"})
"""Units that are others in another spelling."""
_BOUNDS: Final = {
    "time": ("50 ms", "100 us", "1 s"),
    "rate": ("30 Hz", "95 % of offered", "95 % of baseline"),
    "share": ("1 %", "5 %"),
    "size": ("100 MiB", "1 GiB"),
    "power": ("15 W",),
    "energy": ("500 mJ",),
    "count": ("0", "1"),
}


def quantities(rule: ValueRule, before: str) -> Iterator[CompletionProposal]:
    """Yield the units after a number, at a value that is a quantity.

    Args:
        rule: of the value.
        before: what is written of the value.
    """
    kind = rule.quantity
    if rule.is_parsed and kind is not None and issubclass(kind, Quantity):
        yield from _units(kind, before.split(), ends_in_space=before.endswith(" "))


def requirements(analysis: Analysis, context: CursorContext) -> Iterator[CompletionProposal]:
    """Yield metrics; after a metric, operators; after an operator, bounds with their units."""
    words = context.before.split()
    ends_in_space = context.before.endswith(" ")
    if not words or (len(words) == 1 and not ends_in_space):
        yield from metrics(analysis, context)
        yield CompletionProposal(
            "sustained", "the rate is sustained", kind=types.CompletionItemKind.Function
        )
    elif len(words) == 1 or (len(words) == 2 and not ends_in_space):
        yield from (
            CompletionProposal(operator, kind=types.CompletionItemKind.Operator, order=index)
            for index, operator in enumerate(_OPERATORS)
        )
    elif words[1] in _OPERATORS:
        yield from _bounds(_dimension(words[0]), words[2:], ends_in_space=ends_in_space)


def metrics(analysis: Analysis, _: CursorContext) -> Iterator[CompletionProposal]:
    """Yield the metrics that this spec has."""
    spec_context = analysis.known
    subjects = spec_context.subjects if spec_context is not None else NO_SUBJECTS
    monitors = names_of(analysis, "monitor")
    for order, name in enumerate(names(subjects)):
        info = find_metric(name)
        proposal = CompletionProposal(
            name,
            detail=info.dimension,
            documentation=f"{info.description}\n\nFor example: `{info.example}`",
            kind=types.CompletionItemKind.Function,
            order=100 + order,
        )
        yield proposal
        if info.scope is Scope.MONITOR and len(monitors) > 1:
            for monitor in monitors:
                yield CompletionProposal(
                    f"{monitor}.{name}",
                    proposal.detail,
                    proposal.documentation,
                    kind=proposal.kind,
                    order=300 + order,
                )


def _dimension(metric: str) -> str:
    for name in (metric, metric.partition(".")[2]):
        try:
            return find_metric(name).dimension
        except MetricError:
            continue
    return ""


def _bounds(
    dimension: str, words: Sequence[str], *, ends_in_space: bool
) -> Iterator[CompletionProposal]:
    """Yield what can follow an operator, after the words that are written of it."""
    kind = _QUANTITIES.get(dimension)
    if not words:
        yield from (
            CompletionProposal(text, dimension, order=5) for text in _BOUNDS.get(dimension, ())
        )
    elif kind is None:
        return
    elif len(words) == 1 or (len(words) == 2 and not ends_in_space):
        yield from _units(kind, words, ends_in_space=ends_in_space)
        if len(words) == 1 and not ends_in_space and _NUMBER.match(words[0]):
            yield CompletionProposal(f"{words[0]} % of baseline", "of the base version", order=30)
            if dimension == "rate":
                yield CompletionProposal(f"{words[0]} % of offered", "of the rate played", order=31)
    elif len(words) == 2 and words[1] == "%":
        yield CompletionProposal("of baseline", "of the base version", order=30)


def _units(
    kind: type[Quantity], words: Sequence[str], *, ends_in_space: bool
) -> Iterator[CompletionProposal]:
    if not words or len(words) > 2 or not _NUMBER.match(words[0]):
        return
    # With a space after it, the number is a word of its own, which a proposal does not replace.
    number = f"{words[0]} " if len(words) == 1 and not ends_in_space else ""
    for order, unit in enumerate(
        unit_name for unit_name in kind.units if unit_name not in _SPELLINGS
    ):
        yield CompletionProposal(
            f"{number}{unit}", kind.kind, kind=types.CompletionItemKind.Unit, order=1 + order
        )
