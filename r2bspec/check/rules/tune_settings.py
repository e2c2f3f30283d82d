"""`tune`: whether what it names exists, and whether there is anything to search for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

from msgspec.structs import replace

from r2bspec.check import engine
from r2bspec.check.check_context import Context, DocumentFiles
from r2bspec.check.rule import Finding, Findings, rule
from r2bspec.diagnostics.diagnostic import Certainty, Diagnostic, Path, Severity, format_path
from r2bspec.diagnostics.quote import pluralize, quote, quoted_list, suggestion
from r2bspec.judge.measure.metric_catalogue import MetricError, Subjects, resolve
from r2bspec.language.declaration import rule_at, unknown_step
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import MapNode, to_plain, without
from r2bspec.language.spec_tune import Tune
from r2bspec.language.variables import parse_path
from r2bspec.language.yaml_document import to_yaml
from r2bspec.plan.comparability import diff_plans
from r2bspec.plan.plan import Plan
from r2bspec.plan.this_machine import scheduling_facts
from r2bspec.plan.tuning_space import TuningSpace, assignment, value_text

_SECTIONS: Final = ("graph", "containers", "transport")


@rule("R2B801")
def tune_node_unknown(context: Context) -> Findings:
    """Nodes that must not change, and are not in the graph."""
    nodes = context.spec.graph.nodes
    for index, name in enumerate(context.spec.tune.keep):
        if name not in nodes:
            yield Finding(
                message=f"the graph has no node {quote(name)}",
                path=("tune", "keep", index),
                help=suggestion(name, nodes, "its nodes"),
            )


@rule("R2B802")
def tune_path_unknown(context: Context) -> Findings:
    """Paths of values that are no keys of the graph, its containers or its transport."""
    for name in context.spec.tune.values:
        problem = _path_problem(context, name)
        if problem is not None:
            message, help_text = problem
            yield Finding(message=message, path=("tune", "values", name), key=True, help=help_text)


def _path_problem(context: Context, name: str) -> tuple[str, str] | None:
    path = parse_path(name)
    if not path or path[0] not in _SECTIONS:
        help_text = "write one such as graph.nodes.NODE.threads: others change what is measured"
        return f"{quote(name)} is not the path of a key of {quoted_list(_SECTIONS)}", help_text
    position = unknown_step(path)
    if position is not None:
        above, step = rule_at(path[:position]), str(path[position])
        known = (above.keys if above is not None else None) or ()
        message = f"{quote(format_path(path[:position]))} has no key {quote(step)}"
        return message, suggestion(step, known, "its keys")
    for section, owners in (
        (("graph", "nodes"), context.spec.graph.nodes),
        (("containers",), context.spec.containers),
    ):
        owner = str(path[len(section)]) if path[: len(section)] == section != path else ""
        if owner and owner not in owners:
            what = "node" if section[0] == "graph" else "container"
            return f"there is no {what} {quote(owner)}", suggestion(owner, owners, f"{what}s")
    return None


@rule("R2B803")
def tune_value_invalid(context: Context) -> Findings:
    """Values with which the spec is not valid, and such that leave the plan as it is."""
    for path, value, found in _tried(context):
        error = next((each for each in found.new if each.severity is Severity.ERROR), None)
        warning = next((each for each in found.new if each.code in _NO_EFFECT), None)
        if error is not None:
            yield Finding(
                message=f"with {quote(value)} the spec is not valid: {error.code}, {error.message}",
                path=path,
                help=error.help or "remove the value",
                machine_dependent=error.certainty is Certainty.ENVIRONMENT,
            )
        elif warning is not None:
            yield Finding(
                message=f"{quote(value)} changes nothing: {warning.message}",
                path=path,
                help=warning.help,
                code="R2B804",
                severity="warning",
            )
        elif found.same_plan:
            yield Finding(
                message=f"{quote(value)} changes nothing: the plan is the same without it",
                path=path,
                help="remove it: what the spec has is tried in any case",
                code="R2B804",
                severity="warning",
            )


@rule("R2B804")
def tune_lever_without_effect(context: Context) -> Findings:
    """Groups of levers that have no settings here."""
    for index, group in enumerate(context.spec.tune.levers):
        space = _space(context, replace(context.spec.tune, levers=(group,), values={}))
        if not space.levers:
            reasons = [why for why in space.left_out if why.startswith((group, "graph.placement"))]
            yield Finding(
                message=f"{quote(group)} has one setting only, so there is nothing to vary",
                path=("tune", "levers", index),
                help=reasons[0] if reasons else "remove it",
                machine_dependent=True,
            )


_NO_EFFECT: Final = ("R2B221", "R2B222")
"""Findings that a setting has no effect."""


@rule("R2B805")
def tune_threads_above_cores(context: Context) -> Findings:
    """Numbers of threads that this machine, or a limit, does not have."""
    tune, cores = context.spec.tune, len(scheduling_facts().cpus)
    if tune.limits.threads is not None and tune.limits.threads > cores:
        yield _too_many(("tune", "limits", "threads"), tune.limits.threads, cores)
    for name, values in tune.values.items():
        if parse_path(name)[-1:] != ("threads",):
            continue
        for index, value in enumerate(values):
            path: Path = ("tune", "values", name, index)
            if not isinstance(value, int):
                continue
            if tune.limits.threads is not None and value > tune.limits.threads:
                yield Finding(
                    message=f"{pluralize(value, 'thread')} exceed 'tune.limits.threads', "
                    f"{tune.limits.threads}",
                    path=path,
                    help="remove it, or raise the limit",
                )
            elif value > cores:
                yield _too_many(path, value, cores)


def _too_many(path: Path, threads: int, cores: int) -> Finding:
    return Finding(
        message=f"{pluralize(threads, 'thread')} on {pluralize(cores, 'CPU')}: further threads "
        "help only callbacks that wait",
        path=path,
        help=f"use at most {cores}, unless callbacks wait for something else than a processor",
        machine_dependent=True,
    )


@rule("R2B806")
def tune_metric_unknown(context: Context) -> Findings:
    """Metrics to minimize that do not exist, are better when larger, or are of no one monitor."""
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
    """Why a search cannot minimize a metric, and what to do; None if it can.

    Args:
        metric: as a requirement names it.
        monitors: of the spec.
        subjects: that metrics can be of.
        is_observed: whether every start is observed from inside.
    """
    try:
        monitor, info = resolve(metric, monitors, subjects)
    except MetricError as error:
        help_text = f"did you mean {quote(error.suggestion)}?" if error.suggestion else ""
        return str(error), help_text or f"known are {quoted_list(error.known)}"
    if info.dimension in {"rate", "none"} or info.name == "received":
        return (
            f"{quote(info.name)} is better when it is larger",
            "require it in 'slos', and minimize cpu.graph.mean or latency.p99",
        )
    if info.scope == "anatomy" and not is_observed:
        return (
            f"{quote(info.name)} is not observed",
            "write 'benchmark: {anatomy: true}', or use a metric of a monitor",
        )
    if info.scope == "monitor" and monitor is None:
        return (
            f"{quote(info.name)} is of every monitor: {quoted_list(monitors)}",
            f"select one, for example {quote(f'{monitors[0]}.{info.name}')}",
        )
    return None


@rule("R2B807")
def tune_trials_above_space(context: Context) -> Findings:
    """More trials than there are deployments."""
    if context.value_at(("tune", "trials")) is None:
        return
    size = _space(context, context.spec.tune).size
    if context.spec.tune.trials > size:
        yield Finding(
            message=f"there are {pluralize(size, 'deployment')} to try, not "
            f"{context.spec.tune.trials}",
            path=("tune", "trials"),
            help="'r2bspec plan --tune' lists the levers; 'tune.values' adds others",
            machine_dependent=True,
        )


def _space(context: Context, tune: Tune) -> TuningSpace:
    # Few specs have a section 'tune', and its modules are read for them only.
    from r2bspec.plan.derive_space import derive_space

    spec = replace(context.spec, tune=tune)
    return derive_space(spec, context.wiring, scheduling_facts())


class _Tried(NamedTuple):
    """What a value of `tune.values` leads to.

    Attributes:
        new: findings that the spec does not have without it.
        same_plan: whether it leaves the plan as it is.
    """

    new: list[Diagnostic]
    same_plan: bool


def _tried(context: Context) -> Iterator[tuple[Path, str, _Tried]]:
    """Every value whose path exists, tried out alone."""
    values = (
        (("tune", "values", name, index), name, value)
        for name, each in context.spec.tune.values.items()
        if _path_problem(context, name) is None
        for index, value in enumerate(each)
    )
    files = DocumentFiles(context.loaded.base_dir)
    text = ""
    base: tuple[set[tuple[str, str]], Plan | None] | None = None
    for path, name, value in values:
        # Each takes as long as the spec itself; the others are checked when the search begins.
        if not context.files.may_try(context.loaded):
            return
        if base is None:
            tree = context.loaded.tree
            text = to_yaml(to_plain(without(tree, "tune"))) if isinstance(tree, MapNode) else ""
            findings, plan = _with(context, files, text, ())
            base = {(each.code, each.message) for each in findings}, plan
        known, today = base
        findings, plan = _with(context, files, text, (assignment(parse_path(name), value),))
        new = [each for each in findings if (each.code, each.message) not in known]
        same = plan is not None and today is not None and not diff_plans(today, plan)
        yield path, value_text(value), _Tried(new, same)


def _with(
    context: Context, files: DocumentFiles, text: str, sets: tuple[str, ...]
) -> tuple[list[Diagnostic], Plan | None]:
    """The findings and the plan of a spec, its text, with further assignments."""
    from r2bspec.plan.compile_plan import compile_plan

    loaded: LoadedSpec = load_spec(text, file=context.loaded.file, sets=sets)
    other = engine.context_of(loaded, offline=context.offline, files=files)
    if other is None:
        return [*loaded.diagnostics], None
    plan = compile_plan(other.spec, other.bag, wiring=other.wiring)
    return engine.check(loaded, context=other), plan
