"""``r2bspec predict``: what another rate, machine or deployment would do, from one observed run."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli import shared_options as options
from r2bspec.cli.spec_selection import SpecSelection, prepare_and_report
from r2bspec.cli.text_output import print_table
from r2bspec.diagnostics.quote import pluralize
from r2bspec.errors import ExitStatus
from r2bspec.language.quantities import Rate
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.report.output import echo, echo_json

if TYPE_CHECKING:
    from r2bspec.tune.prediction import Estimate, Prediction

_MAX_CORES = 4096


@click.command("predict")
@options.spec_argument
@click.argument("run", type=options.FOLDER)
@options.repeatable_option(
    "--rate",
    "rates",
    type=options.QuantityType(Rate, "0.01 Hz", "1000000 Hz"),
    metavar="RATE",
    help="Predict this rate instead of those of SPEC, such as '60 Hz'",
)
@click.option(
    "--cores",
    type=click.IntRange(min=1, max=_MAX_CORES),
    help="The cores of the machine.  [default: those of the machine of RUN]",
)
@options.format_option()
@options.spec_options
def command(
    spec: Path,
    run: Path,
    rates: tuple[Rate, ...],
    cores: int | None,
    output_format: str,
    values: SelectionValues,
) -> int:
    """Predict latency and peak rate of SPEC from the run in the folder RUN; needs no ROS.

    RUN is a run of the same graph with its anatomy ('r2bspec run SPEC --anatomy'), in any
    deployment; --set and --var choose the one to predict. Intervals have 90 %. What the model does
    not know is said to be not known, with the reason. A prediction is no verdict: the exit status
    does not depend on it.
    """
    from r2bspec.record.run_folder import open_run
    from r2bspec.tune.predict import predict_deployment

    prepared = prepare_and_report(SpecSelection(spec, **values), infos=False)
    found = predict_deployment(
        open_run(run), prepared.plan, rates_hz=tuple(rate.si for rate in rates), cores=cores
    )
    if output_format == "json":
        import msgspec

        echo_json(msgspec.to_builtins(found))
    else:
        own_hz = {each.at.si for each in prepared.plan.objectives.values() if each.at is not None}
        _show(found, run, own_hz)
    return ExitStatus.OK


def _show(found: Prediction, run: Path, own_hz: Collection[float]) -> None:
    from r2bspec.judge.measure.units import show

    echo(f"{found.name} on {pluralize(found.cores, 'core')}, predicted from {run}")
    if found.reason:
        echo(f"not known: {found.reason}")
        return
    loads = {rate_hz: (process, load) for rate_hz, process, load in found.loads}
    rows = []
    for each in found.latencies:
        process, load = loads[each.rate_hz]
        busy = f"{process} {min(load, 1.0) * 100:.0f} %"
        metric = f"{each.monitor}.{each.metric}"
        rows.append((show(each.rate_hz, "Hz"), busy, metric, *_cells(each.estimate, "s")))
    rows.append(("", "", "peak.rate", *_cells(found.peak, "Hz")))
    print_table(("offered", "busiest thread", "metric", "predicted", "90 % interval"), rows, (0, 3))
    if found.requirements:
        echo()
    if own_hz and any(each.rate_hz not in {None, *own_hz} for each in found.requirements):
        echo("The requirements of the spec, asked at these rates in place of their own:")
    for required in found.requirements:
        at = f" at {show(required.rate_hz, 'Hz')}" if required.rate_hz else ""
        echo(f"{required.answer:<10}  {required.objective}: {required.text}{at}  {required.reason}")


def _cells(estimate: Estimate, unit: str) -> tuple[str, str]:
    from r2bspec.judge.measure.units import show

    if estimate.value is None:
        return "not known", estimate.reason
    return show(estimate.value, unit), f"{show(estimate.low, unit)} … {show(estimate.high, unit)}"
