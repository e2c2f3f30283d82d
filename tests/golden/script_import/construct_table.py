"""Prints the table of constructs.md: what scripts of the corpus call, and what becomes of it.

A call is not imported if a finding R2B710 is in its lines, and imported in another way if a finding
R2B711 is. A finding is about the innermost call.
"""

from __future__ import annotations

import ast
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from r2bspec.diagnostics import Diagnostic
from r2bspec.interop.script_import.benchmark_script import read_benchmark_script
from r2bspec.interop.script_import.spec_builder import build_spec

SCRIPTS = Path(__file__).parent / "scripts"
CONSTRUCTS = {
    "ComposableNode": ("ComposableNode",),
    "ComposableNodeContainer, LoadComposableNodes": (
        "ComposableNodeContainer",
        "LoadComposableNodes",
    ),
    "Node, ExecuteProcess": ("Node", "ExecuteProcess"),
    "GroupAction, SetRemap": ("GroupAction", "SetRemap"),
    "IncludeLaunchDescription": ("IncludeLaunchDescription",),
    "Resolution": ("Resolution",),
    "ROS2BenchmarkConfig": ("ROS2BenchmarkConfig",),
    "MonitorPerformanceCalculatorsInfo": ("MonitorPerformanceCalculatorsInfo",),
    "TRTConverter": ("TRTConverter",),
    "ESSEngineGenerator": ("ESSEngineGenerator",),
    "create_service_client_blocking, create_client": (
        "create_service_client_blocking",
        "create_client",
    ),
    "call_async, call": ("call_async", "call"),
    "os.path.isfile, os.path.exists": ("isfile", "exists"),
    "os.makedirs, shutil.copy": ("makedirs", "copy"),
    "subprocess.run": ("run",),
    "time.sleep": ("sleep",),
}
"""Constructs by the names that are called."""


@dataclass(slots=True)
class Row:
    """One line of the table."""

    scripts: set[str] = field(default_factory=set)
    calls: int = 0
    lost: int = 0
    otherwise: int = 0
    reasons: Counter[str] = field(default_factory=Counter)


def calls(tree: ast.Module) -> Iterator[tuple[str, ast.Call]]:
    """The calls of constructs."""
    kinds = {name: kind for kind, names in CONSTRUCTS.items() for name in names}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call):
            called = node.func
            name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
            if name in kinds:
                yield kinds[name], node


def innermost(found: list[tuple[str, ast.Call]], finding: Diagnostic) -> ast.Call | None:
    """The shortest call that a finding is in."""
    line = finding.span.line
    around = [call for _, call in found if call.lineno <= line <= (call.end_lineno or call.lineno)]
    return min(around, key=lambda each: (each.end_lineno or 0) - each.lineno, default=None)


def rows() -> dict[str, Row]:
    """The lines of the table by construct."""
    table = {kind: Row() for kind in CONSTRUCTS}
    for script in sorted(SCRIPTS.glob("*.py")):
        read = read_benchmark_script(script)
        found = list(calls(read.module.tree))
        lost: dict[ast.Call, str] = {}
        otherwise: set[ast.Call] = set()
        for each in build_spec(read, SCRIPTS).findings:
            call = innermost(found, each) if Path(each.span.file).name == script.name else None
            if each.code == "R2B710" and call is not None:
                lost[call] = each.message.rpartition(": ")[2]
            elif call is not None:
                otherwise.add(call)
        for kind, call in found:
            row = table[kind]
            row.scripts.add(script.stem)
            row.calls += 1
            if call in lost:
                row.lost += 1
                row.reasons[lost[call]] += 1
            elif call in otherwise:
                row.otherwise += 1
    return table


def markdown() -> str:
    """The table."""
    lines = [
        "| call | scripts | calls | imported | in another way | not imported, and why |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for kind, row in rows().items():
        names = ", ".join(f"`{each}`" for each in kind.split(", "))
        why = "; ".join(f"{count}: {reason}" for reason, count in sorted(row.reasons.items()))
        imported = row.calls - row.lost - row.otherwise
        numbers = f"{len(row.scripts)} | {row.calls} | {imported} | {row.otherwise}"
        lines.append(f"| {names} | {numbers} | {why} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.stdout.write(markdown() + "\n")
