"""What may vary: variables, and the values and the metric of `tune`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, rule
from r2bspec.diagnostics.diagnostic import Path, format_path
from r2bspec.diagnostics.quote import quote, quoted_list
from r2bspec.judge.measure.metric import Scope
from r2bspec.judge.measure.metric_catalogue import MetricError, Subjects, resolve
from r2bspec.language.declaration import rule_at
from r2bspec.language.located_tree import MapNode, TreeNode, entries_of, items_of, lookup
from r2bspec.language.structure import read_value
from r2bspec.language.variables import missing_step, parse_path

_SECTIONS: Final[tuple[Path, ...]] = (("graph",), ("containers",), ("transport",))
_WHOLE_SECTIONS: Final = _SECTIONS[:2]


@rule("R2B616")
def variable_unused(context: Context) -> Findings:
    """Find variables that are not used."""
    for name in context.spec.variables:
        if name not in context.loaded.used_variables:
            yield Finding(
                message=f"variable {quote(name)} is not used",
                path=("variables", name),
                key=True,
                help=f"use it with {quote(f'$(var {name})')}, or remove it",
            )


@rule("R2B809")
def tune_value_invalid(context: Context) -> Findings:
    """Find paths that the spec does not have, and values that their keys do not accept."""
    from r2bspec.language.explain_violations import explain_violations

    root = context.loaded.tree
    listed = entries_of(lookup(root, ("tune", "values")))
    paths = {name: parse_path(name) for name in listed}
    for name, entry in listed.items():
        path = paths[name]
        others = [above for other, above in paths.items() if above and other != name]
        if (problem := _path_problem(root, path, others)) is not None:
            message, help_text = problem
            message = f"{quote(name)} {message}"
            yield Finding(message=message, path=("tune", "values", name), key=True, help=help_text)
            continue
        value_rule = rule_at(path)
        for index, value in enumerate(items_of(entry.value)):
            place: Path = ("tune", "values", name, index)
            if isinstance(value, MapNode):
                message = f"a map is no value of {quote(name)}"
                yield Finding(message=message, path=place, help="list values of the keys below it")
            elif value_rule is not None:
                _, violations = read_value(value, value_rule, context.loaded.sources, path)
                for explained in explain_violations(violations)[:1]:
                    yield Finding(message=explained.message, path=place, help=explained.help)


def _path_problem(
    root: TreeNode | None, path: Path, others: Sequence[Path]
) -> tuple[str, str] | None:
    """Return why a path cannot be varied, and what to write instead; None if it can be."""
    if path[:1] not in _SECTIONS or path in _WHOLE_SECTIONS:
        help_text = "write one such as graph.nodes.NODE.threads: others change what is measured"
        return "is not the path of a key of the graph, a container or the transport", help_text
    if any(isinstance(step, int) for step in path):
        return "is inside a list", "list values of the whole list"
    if (missing := missing_step(root, path)) is not None:
        position, help_text = missing
        return f"is unknown: there is no {quote(format_path(path[: position + 1]))}", help_text
    for above in others:
        if path[: len(above)] == above:
            return (
                f"is inside {quote(format_path(above))}, which is varied, too",
                "vary one of them",
            )
    return None


@rule("R2B810")
def tune_metric_unknown(context: Context) -> Findings:
    """Find metrics to minimize that do not exist, are better when larger, or need a monitor."""
    if context.value_at(("tune",)) is None:
        return
    spec = context.spec
    problem = goal_problem(
        spec.tune.minimize,
        list(spec.outputs),
        context.subjects,
        is_observed=bool(spec.benchmark.anatomy),
    )
    if problem is not None:
        message, help_text = problem
        yield Finding(message=message, path=("tune", "minimize"), help=help_text)


def goal_problem(
    metric: str, monitors: Sequence[str], subjects: Subjects, *, is_observed: bool
) -> tuple[str, str] | None:
    """Return why a search cannot minimize a metric, and what to do; None if it can.

    Args:
        metric: as a requirement names it.
        monitors: the monitors of the spec.
        subjects: the subjects that metrics can be of.
        is_observed: whether every start is observed from inside.
    """
    try:
        monitor, info = resolve(metric, monitors, subjects)
    except MetricError as error:
        help_text = f"did you mean {quote(error.suggestion)}?" if error.suggestion else ""
        return str(error), help_text or f"known are {quoted_list(error.known)}"
    if info.metric.more_is_better:
        return (
            f"{quote(info.name)} is better when it is larger",
            "require it in 'slos', and minimize cpu.graph.mean or latency.p99",
        )
    if info.scope is Scope.ANATOMY and not is_observed:
        return (
            f"{quote(info.name)} is not observed",
            "write 'benchmark: {anatomy: true}', or use a metric of a monitor",
        )
    if info.scope is Scope.MONITOR and monitor is None:
        return (
            f"{quote(info.name)} is of every monitor: {quoted_list(monitors)}",
            f"select one, for example {quote(f'{monitors[0]}.{info.name}')}",
        )
    return None
