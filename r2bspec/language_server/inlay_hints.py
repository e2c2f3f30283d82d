"""Figures that follow from a spec, shown where they are decided."""

from __future__ import annotations

from collections.abc import Iterator

from lsprotocol import types

from r2bspec.check.check_context import Context
from r2bspec.diagnostics import Path
from r2bspec.errors import R2bspecError
from r2bspec.language.located_tree import ScalarNode, lookup, scalars_with_paths
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.text_positions import TextPositions
from r2bspec.plan.compile_plan import compile_plan
from r2bspec.plan.time_estimate import estimate_time


def inlay_hints(analysis: Analysis, positions: TextPositions) -> Iterator[types.InlayHint]:
    """The time of a run, the steps of an iteration, and the values of variables."""
    context = analysis.context
    if context is None:
        return
    hints = [
        (("benchmark",), True, _time_of_run(context)),
        *_steps(context),
    ]
    for path, is_key, text in hints:
        span = analysis.loaded.span(path, key=is_key)
        if text and span.file == str(analysis.path):
            yield _after(positions, positions.offsets(span)[1] + int(is_key), text)
    yield from _values(analysis, positions)


def _time_of_run(context: Context) -> str:
    if any(each.severity == "error" for each in context.loaded.diagnostics):
        return ""
    try:
        plan = compile_plan(
            context.spec,
            context.require_bags(),
            companion_files=context.companion_files,
            wiring=context.wiring,
        )
    except (R2bspecError, ValueError, KeyError):
        # A spec with findings may have no plan; the findings are shown.
        return ""
    return f"a run takes {estimate_time(plan).text()}"


def _steps(context: Context) -> Iterator[tuple[Path, bool, str]]:
    benchmark = context.spec.benchmark
    for index, rate in enumerate(benchmark.rates):
        steps = round(rate.hz * benchmark.duration.seconds)
        yield (
            ("benchmark", "rates", index),
            False,
            f"{steps:,} steps x {benchmark.iterations}",
        )


def _values(analysis: Analysis, positions: TextPositions) -> Iterator[types.InlayHint]:
    """The values of what is written with a reference."""
    own = analysis.written.get(str(analysis.path))
    tree = analysis.loaded.tree
    if own is None or tree is None:
        return
    for path, written in scalars_with_paths(own):
        if "$(" not in written.text:
            continue
        value = lookup(tree, path)
        if isinstance(value, ScalarNode) and value.text != written.text and not value.secret:
            end = positions.offsets(written.span)[1]
            yield _after(positions, end, f"= {value.text[:40]}")


def _after(positions: TextPositions, offset: int, text: str) -> types.InlayHint:
    return types.InlayHint(positions.position(offset), text, padding_left=True)
