"""The report of a run: its result as a document."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import replace

from r2bspec.compare.report_input import ReportInput
from r2bspec.errors import split_output
from r2bspec.judge.measure.metric import PROCESS, SECTIONS, MetricInfo, Outputs, Scope
from r2bspec.judge.measure.metric_catalogue import WHOLE_GRAPH
from r2bspec.judge.measure.metric_declarations import DECLARED
from r2bspec.judge.measure.metrics import RateMetrics, RunMetrics
from r2bspec.judge.measure.units import at_rate, show, show_rate, significant
from r2bspec.judge.result import Result
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.report import anatomy_table, wording
from r2bspec.report.document import (
    Block,
    Cell,
    Chart,
    Column,
    Detail,
    Document,
    Fold,
    Items,
    Paragraph,
    Row,
    Section,
    Table,
    Verbatim,
    number,
)
from r2bspec.report.notes import notes, profile_texts
from r2bspec.report.result_table import (
    Measured,
    is_roomy,
    measured,
    monitor_names,
    pointer,
    section_metrics,
    summary_metrics,
)

Charts = Mapping[str, Sequence[Chart]]
"""The charts of a page, by the title of their section."""


def result_document(
    report_input: ReportInput, *, whole: bool = False, charts: Charts | None = None
) -> Document:
    """Return the report of a run.

    Args:
        report_input: the result, with what it was computed from.
        whole: with every path of the anatomy, as reports have it that can fold.
        charts: the charts of a page.
    """
    result, verbose = report_input.result, report_input.verbose
    line, drawn = wording.headline(result), charts or {}
    told, profiles = notes(result, verbose=verbose), tuple(profile_texts(result.profiles))
    sections = (
        Section("Verdicts", tuple(_verdict_blocks(result, verbose=verbose))),
        Section("Notes", (Items(told),) if told else ()),
        Section("Graph", tuple(drawn.get("Graph", ())), detail=Detail.PAGE),
        Section(
            "Measurements",
            (*drawn.get("Measurements", ()), *_measurement_blocks(report_input)),
            folded=True,
        ),
        Section("Load", (*drawn.get("Load", ()), *_load_blocks(result)), folded=True),
        Section(
            "Anatomy",
            tuple(_anatomy_blocks(result, whole=whole or verbose)),
            folded=True,
        ),
        Section("Profile", (Items(profiles),) if profiles else ()),
        Section(
            "Environment", tuple(_environment_blocks(result)), folded=True, detail=Detail.COMMENT
        ),
    )
    return Document(
        line=line,
        word=wording.overall_word(result.verdict),
        outcome=result.verdict.outcome,
        lead=tuple(filter(None, (wording.reason_after(line, result.verdict), *_lead(result)))),
        title=result.title if result.title != result.name else "",
        facts=tuple(_facts(result)),
        sections=tuple(section for section in sections if section.blocks),
        back=report_input.suite_link,
        footer=f"Made by r2bspec {result.versions.get('r2bspec', '')}. "
        "Every value is in result.json.",
    )


def _lead(result: Result) -> Iterator[str]:
    if result.judged_by:
        yield f"Judged by the objectives and the gate of {result.judged_by}."
    yield from wording.comparison(result)


def _facts(result: Result) -> Iterator[str]:
    cores, quota = result.machine.get("cores"), result.machine.get("cpu_quota")
    facts = (
        str(result.machine.get("cpu") or ""),
        f"{cores} cores" if cores else "",
        f"limited to the CPU time of {quota:g}" if quota else "",
        wording.loaded_rmw(result),
        str(result.dataset.get("source") or ""),
        wording.code_text(result),
        wording.starts_text(result.starts),
        *(result.load or ()),
        *(f"{key}: {value}" for key, value in result.labels.items()),
    )
    yield from filter(None, facts)


# Requirements: one table for a run and for several.


def requirement_columns(
    verdicts: Iterable[RequirementVerdict], *, specs: bool = False
) -> tuple[Column, ...]:
    """Return the columns of a table of requirements; see `requirement_cells`."""
    listed = [*verdicts]
    confidences = {one.confidence for one in listed}
    bounds = "bounds"
    if len(confidences) == 1:
        bounds = f"{show(confidences.pop(), 'share', 4)} bounds"
    compared = any(one.compared is not None for one in listed)
    return (
        Column("verdict", number=False),
        *((Column("spec", number=False),) if specs else ()),
        Column("requirement", number=False),
        Column("at", detail=_at_detail(listed)),
        *((Column("base", detail=Detail.ROOMY),) if compared else ()),
        Column("head" if compared else f"estimate [{bounds}]"),
        *((Column(f"ratio [{bounds}]"),) if compared else ()),
        Column("limit", detail=Detail.COMMENT),
        Column("n", detail=Detail.PAGE),
        Column("method", number=False, detail=Detail.PAGE),
    )


def _at_detail(listed: Sequence[RequirementVerdict]) -> Detail:
    """Return where the rates of requirements have a column: a single one is in the heading."""
    rates = {one.at_hz for one in listed}
    if not any(rates):
        return Detail.PAGE
    return Detail.ALWAYS if len(rates) > 1 else Detail.COMMENT


def requirement_rows(
    result: Result,
    columns: Sequence[Column],
    *,
    verbose: bool = False,
    spec: Cell | None = None,
) -> list[Row]:
    """Return a row for each requirement of a run, unmet requirements first.

    Args:
        result: the result of the run.
        columns: as `requirement_columns` returns them.
        verbose: with the reasons of requirements that are met, too.
        spec: the cell that names the run, if the table has a column for it.
    """
    verdict = result.verdict
    order = ("fail", "inconclusive", "pass")
    indices = sorted(
        range(len(verdict.requirements)),
        key=lambda place: (
            order.index(verdict.requirements[place].outcome),
            verdict.requirements[place].compared is None,
        ),
    )
    compares = any(column.title == "base" for column in columns)
    several = wording.several_monitors(verdict)
    said: dict[str, str] = {}
    rows = []
    for index in indices:
        one = verdict.requirements[index]
        path = f"verdict/requirements/{index}"
        text = wording.requirement_text(one, name_monitor=several)
        details: tuple[str, ...] = ()
        if verbose or one.outcome != "pass":
            details = tuple(_reasons(one, text, said, result, verbose=verbose))
        cells = (
            Cell(wording.verdict_word(one)),
            *((spec,) if spec is not None else ()),
            Cell(text, before=f"{one.objective}:", code=True),
            _rate_cell(one, path, result.metrics),
            *_estimates(one, path, compares=compares),
            Cell("") if one.limit is None else number(one.limit, one.unit, f"{path}/limit"),
            number(one.n, "count", f"{path}/n"),
            Cell(one.method),
        )
        rows.append(Row(cells, details, outcome=one.outcome))
    return rows


def _reasons(
    one: RequirementVerdict, text: str, said: dict[str, str], result: Result, *, verbose: bool
) -> Iterator[str]:
    """Return the reason of a requirement, and what would decide it; nothing is said twice.

    Of several requirements with one reason, such as a monitor that received nothing, the others
    refer to the first. What a busy machine leaves open, no advice about the graph decides.
    """
    if one.reason in said:
        yield f"As for {said[one.reason]}."
        return
    said[one.reason] = text
    # The cells of a ratio say it.
    if verbose or one.compared is None or one.estimate is None:
        yield one.reason
    if one.remedy and not wording.open_on_busy_machine(one, result):
        yield one.remedy


def _rate_cell(one: RequirementVerdict, path: str, metrics: RunMetrics) -> Cell:
    if one.at_hz:
        return number(one.at_hz, "Hz", f"{path}/at_hz")
    return Cell("" if one.at_hz is None else show_rate(0, wording.own_pace(metrics)))


def _estimates(one: RequirementVerdict, path: str, *, compares: bool) -> tuple[Cell, ...]:
    """Return the cells of base, head and ratio, or of the estimate alone, with its bounds."""
    exact = None if one.lost else one.estimate
    estimate = Cell(
        wording.estimate_text(one),
        exact,
        "" if exact is None else f"{path}/estimate",
        after=wording.bounds_text(one),
    )
    if not compares:
        return (estimate,)
    if one.compared is None:
        return Cell(""), estimate, Cell("")
    unit, found = one.compared.unit, one.compared
    return (
        number(found.base, unit, f"{path}/compared/base"),
        number(found.head, unit, f"{path}/compared/head"),
        estimate,
    )


def _verdict_blocks(result: Result, *, verbose: bool) -> Iterator[Block]:
    verdict = result.verdict
    _, output = split_output(verdict.reason)
    if output:
        yield Verbatim(output)
    if not verdict.requirements:
        yield Paragraph("The spec has no requirements.", detail=Detail.PAGE)
        return
    columns = requirement_columns(verdict.requirements)
    rows = requirement_rows(result, columns, verbose=verbose)
    rates = {one.at_hz for one in verdict.requirements}
    rate = rates.pop() if len(rates) == 1 else None
    at = "" if rate is None else at_rate(rate, wording.own_pace(result.metrics))
    yield Table("requirements", columns, tuple(rows), at)


# What monitors received.


def _measurement_blocks(report_input: ReportInput) -> Iterator[Block]:
    result = report_input.result
    metrics = result.metrics
    if report_input.run is None:
        text = "Made from a result.json; the charts of single messages need the run folder."
        yield Paragraph(text, quiet=True, detail=Detail.PAGE)
    for name in monitor_names(metrics):
        title = result.monitor_title(name)
        yield _summary_table(title, [*measured(metrics, name)])
        for section in SECTIONS:
            columns = section_metrics(section)
            yield _metric_table(f"{title}: {section}", columns, measured(metrics, name))
    yield from _search_blocks(metrics)


def _summary_table(title: str, rows: Sequence[Measured]) -> Table:
    """Return the table of a monitor: a line for each rate, below it the range over iterations."""
    outputs: Outputs = "answers"
    if not all(row.seen.is_expected for row in rows):
        outputs = "live" if any(row.rate.pace == "source" for row in rows) else "own pace"
        if all(row.seen.values.get("sent") is not None for row in rows):
            outputs = "any"
    family = "age" if outputs == "own pace" else "latency"
    chosen = summary_metrics(outputs)
    columns = (
        Column("offered", number=False),
        *(
            Column(info.title, detail=Detail.ROOMY if is_roomy(info) else Detail.ALWAYS)
            for info in chosen
        ),
    )
    lines: list[Row] = []
    for row in rows:
        lines.append(Row((Cell(row.offered), *(_metric_cell(row, info) for info in chosen))))
        number_of = len(row.rate.iterations)
        if number_of > 1:
            cells = (Cell(f"× {number_of}"), *(Cell(row.range_text(info)) for info in chosen))
            lines.append(Row(cells, quiet=True))
    ranges = any(line.quiet for line in lines)
    aside = f"{family}; below each line, the range over the iterations" if ranges else family
    return Table(title, columns, tuple(lines), aside)


def _metric_cell(row: Measured, info: MetricInfo) -> Cell:
    return number(row.seen.value(info), info.unit, f"{row.path}/{info.place}")


def _metric_table(title: str, metrics: Sequence[MetricInfo], rows: Iterable[Measured]) -> Table:
    """Return a table of metrics of a monitor, which only pages have room for."""
    columns = (
        Column("offered", number=False),
        *(Column(info.title) for info in metrics),
    )
    lines = tuple(
        Row(
            (
                Cell(row.offered),
                *(_metric_cell(row, info) for info in metrics),
            )
        )
        for row in rows
    )
    return Table(title, columns, lines, detail=Detail.PAGE)


def _search_blocks(metrics: RunMetrics) -> Iterator[Block]:
    search = metrics.search
    if search is not None and search.probes:
        marks = " ".join(f"{one.rate_hz:.4g}{wording.probe_mark(one)}" for one in search.probes)
        failed = [one for one in search.probes if one.rate_hz == search.fails_hz]
        why = ""
        if failed and failed[-1].holds is False:
            why = f". At {show(failed[-1].rate_hz, 'Hz')}: {failed[-1].reason}"
        yield Paragraph(f"Search: peak {wording.peak_text(search)}. Probes, in Hz: {marks}{why}")


# What processes used.


def _load_blocks(result: Result) -> Iterator[Block]:
    rates = result.metrics.rates
    if not rates:
        return
    columns = [
        info
        for metric in DECLARED
        if metric.placeholder == PROCESS
        for info in metric.infos
        if info.part in metric.columns
    ]
    yield Table(
        "load",
        (
            Column("process", number=False),
            Column("offered"),
            *(Column(info.title) for info in columns),
        ),
        tuple(_load_rows(rates, columns)),
        "CPU: 100 % is one core; work: processor time a step",
    )
    if devices := tuple(_device_rows(rates)):
        names = (Column("metric", number=False), Column("offered"), Column("value"))
        yield Table("devices", names, devices, "GPUs (NVML) and processor packages (RAPL)")


def _load_rows(rates: Sequence[RateMetrics], columns: Sequence[MetricInfo]) -> Iterator[Row]:
    processes = {
        info.subject: info.subject
        for rate in rates
        for _, info, _ in rate.pooled.entries(Scope.PROCESS)
    }

    def used(process: str) -> list[list[float | None]]:
        of_process = [replace(info, subject=process) for info in columns]
        return [[rate.pooled.value(info) for info in of_process] for rate in rates]

    # Of a graph in one process, its row says the same.
    if not any(used(process) == used(WHOLE_GRAPH) for process in processes):
        processes[WHOLE_GRAPH] = "whole graph"
    for process, title in (processes | {"system": "whole machine"}).items():
        for index, (rate, values) in enumerate(zip(rates, used(process), strict=True)):
            if any(value is not None for value in values):
                cells = (
                    _use_cell(replace(info, subject=process), value, index)
                    for info, value in zip(columns, values, strict=True)
                )
                yield Row((Cell(title), Cell(show_rate(rate.offered_hz, rate.pace)), *cells))


def _use_cell(info: MetricInfo, value: float | None, index: int) -> Cell:
    escaped = replace(info, subject=pointer(info.subject))
    path = f"metrics/rates/{index}/pooled/{escaped.place}"
    if value is None:
        return Cell("")
    return _share_cell(value, path) if info.unit == "share" else number(value, info.unit, path)


def _device_rows(rates: Sequence[RateMetrics]) -> Iterator[Row]:
    infos = {name: info for rate in rates for name, info, _ in rate.pooled.entries(Scope.DEVICE)}
    for name, info in infos.items():
        for index, rate in enumerate(rates):
            path = f"metrics/rates/{index}/pooled/values/{pointer(name)}"
            cell = number(rate.pooled.value(info), info.unit, path)
            yield Row((Cell(name), Cell(show_rate(rate.offered_hz, rate.pace)), cell))


def _share_cell(share: float, path: str) -> Cell:
    """Return a share of a core; whole percents from 10 on: it is counted no finer."""
    text = significant(share * 100, 2) if share < 0.1 else f"{share * 100:.0f}"
    return Cell(f"{text} %", share, path)


# Where messages spent their time.


def _anatomy_blocks(result: Result, *, whole: bool) -> Iterator[Block]:
    for anatomy in anatomy_table.anatomies_of(result):
        first = {path.monitor: path for path in reversed(anatomy.paths)}
        shown = [path for path in anatomy.paths if whole or path is first[path.monitor]]
        for path in shown:
            yield Table(
                f"anatomy of {anatomy_table.title(anatomy, path)}",
                _columns(anatomy_table.PART_COLUMNS, words=2),
                _text_rows(anatomy_table.part_rows(path)),
                anatomy_table.caption(path),
            )
        nodes = _text_rows(anatomy_table.node_rows(anatomy))
        if nodes:
            same = "the same" if first else "one"
            at = f" {at_rate(anatomy.rate_hz)}" if anatomy.rate_hz else ""
            yield Table(
                f"nodes{at}",
                _columns(anatomy_table.NODE_COLUMNS),
                nodes,
                f"in {same} iteration; {anatomy_table.NODES_CAPTION}",
            )
        texts = [*anatomy_table.anatomy_notes(anatomy)]
        if more := len(anatomy.paths) - len(shown):
            texts.append(f"--verbose shows the other paths, {more} more")
        yield from (Paragraph(text, quiet=True) for text in texts)


def _columns(titles: Sequence[str], words: int = 1) -> tuple[Column, ...]:
    return tuple(Column(title, number=place >= words) for place, title in enumerate(titles))


def _text_rows(rows: Iterable[Sequence[str]]) -> tuple[Row, ...]:
    return tuple(Row(tuple(map(Cell, row))) for row in rows)


# Machine, data and code.


def _environment_blocks(result: Result) -> Iterator[Block]:
    facts = {
        "name": result.name,
        "run": result.run_id,
        "status": result.status,
        "started": result.started_at,
        "ended": result.ended_at,
        "plan": result.plan_hash,
        "starts": wording.starts_text(result.starts),
        **{f"dataset {key}": value for key, value in result.dataset.items()},
        **{f"machine {key}": value for key, value in result.machine.items()},
        **{f"version of {key}": value for key, value in result.versions.items()},
        **wording.code_facts(result),
    }
    rows = _text_rows((key, _plain(value)) for key, value in facts.items() if value != "")
    yield Table("environment", _columns(("what", "value"), words=2), rows)
    yield Fold("The resolved spec", (Verbatim(result.spec),), Detail.PAGE)


def _plain(value: Any) -> str:
    """Return a fact as text: lists and maps as JSON, nothing as a dash."""
    if isinstance(value, str | int | float):
        return str(value)
    return msgspec.json.encode(value).decode() if value else "-"
