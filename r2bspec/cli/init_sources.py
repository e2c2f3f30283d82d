"""``r2bspec init --from-...``: a first spec from a bag, a launch file, a graph or a node."""

from __future__ import annotations

import ast
import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.errors import UsageError

if TYPE_CHECKING:
    from r2bspec.authoring.draft_nodes import DraftNodes
    from r2bspec.authoring.draft_spec import Recording


@dataclass(frozen=True, slots=True)
class InitSources:
    """What a first spec is made from.

    Attributes:
        bag: a recording or the name of a dataset.
        launch: a launch file, a package, or PACKAGE:FILE.
        graph: whether the running ROS graph is read.
        node: a Python node, as a spec names it.
        timeout_s: how long to wait for nodes of the graph.
    """

    bag: str = ""
    launch: str = ""
    graph: bool = False
    node: str = ""
    timeout_s: float = 10.0

    @property
    def are_given(self) -> bool:
        """Whether there is a source that templates do not have."""
        return bool(self.bag or self.launch or self.graph)


def spec_from_sources(name: str, folder: Path, sources: InitSources) -> str:
    """The text of a spec.

    Args:
        name: of the benchmark.
        folder: of the spec.
        sources: what it is made from.

    Raises:
        UsageError: a source does not exist or cannot be read.
        DataError: the recording cannot be read.
    """
    from r2bspec.authoring.draft_nodes import DraftNodes
    from r2bspec.authoring.draft_spec import draft_text

    draft, shown = DraftNodes(), []
    if sources.node:
        _add_python_node(draft, sources.node)
        shown.append(f"the node {sources.node}")
    if sources.launch:
        shown.append(f"the launch file {_add_launch_file(draft, sources.launch, folder)}")
    if sources.graph:
        from r2bspec.authoring.graph_nodes import add_graph_nodes, inspect_graph

        add_graph_nodes(draft, inspect_graph(sources.timeout_s))
        shown.append("the running ROS graph")
    recording = _recording(sources.bag, folder) if sources.bag else None
    if recording is not None:
        shown.append(f"the recording {recording.written}")
    return draft_text(name, shown, draft, recording, folder)


def check_node_file(target: str, folder: Path) -> None:
    """Check that the file of a node exists and defines it.

    Args:
        target: as a spec names it; nothing is checked of a module.
        folder: of the spec.

    Raises:
        UsageError: it does not.
    """
    from r2bspec.check.installed_packages import top_level_names
    from r2bspec.check.python_target import python_target
    from r2bspec.untrusted.safe_file import is_regular
    from r2bspec.wiring.ast_reader import read_python_file

    found = python_target(target, folder)
    if found.module:
        return
    if not is_regular(found.file):
        hint = "Paths are relative to the folder of the spec."
        raise UsageError(f"{found.file} does not exist", hint=hint)
    try:
        names = top_level_names(found.file)
    except SyntaxError as error:
        raise UsageError(f"{found.file}:{error.lineno}: {error.msg}") from error
    if names is not None and found.name not in names:
        tree = read_python_file(found.file)
        classes = (
            [each.name for each in tree.body if isinstance(each, ast.ClassDef)] if tree else []
        )
        raise UsageError(
            f"{found.file} has no class or function {found.name!r}",
            hint=f"Its classes: {', '.join(classes) or 'none'}.",
        )


def is_readable_node(target: str, folder: Path) -> bool:
    """Whether a target is a class of a node, in a file whose source tells its topics or not."""
    from r2bspec.check.python_target import python_target
    from r2bspec.wiring.ast_reader import read_node_class, read_python_file

    found = python_target(target, folder)
    tree = read_python_file(found.file) if not found.module and found.readable else None
    return tree is not None and read_node_class(tree, found.name) is not None


def _add_python_node(draft: DraftNodes, target: str) -> None:
    from r2bspec.interop.script_import.yaml_writer import Block
    from r2bspec.language.templates import node_key

    entry = Block()
    entry.add("python", target)
    draft.nodes.add(node_key(target), entry)


def _add_launch_file(draft: DraftNodes, wanted: str, folder: Path) -> str:
    from r2bspec.authoring.launch_nodes import add_launch_nodes, find_launch_file
    from r2bspec.interop.script_import.script_reader import UnusableScriptError

    file = find_launch_file(wanted)
    try:
        add_launch_nodes(draft, file, folder)
    except UnusableScriptError as error:
        span = error.finding.span
        raise UsageError(
            f"{span.file}:{span.line}:{span.column}: {error.finding.message}",
            code=error.finding.code,
        ) from error
    return file.name


def _recording(bag: str, folder: Path) -> Recording:
    from r2bspec.authoring.draft_spec import Recording
    from r2bspec.datasets.locate_bag import index, locate

    location = locate(bag, Path())
    written = location.dataset
    if written is None:
        relative = os.path.relpath(Path(bag).expanduser().absolute(), folder.absolute())
        written = relative if relative.startswith(".") else f"./{relative}"
    return Recording(written, index(location))
