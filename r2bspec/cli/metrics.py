"""``r2bspec metrics``: what every metric means, where it is known, and how it is judged."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

import click

from r2bspec.cli.completions import complete_metric
from r2bspec.errors import UsageError
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo, echo_document

_WIDTH = 88


@click.command("metrics")
@click.argument("names", nargs=-1, metavar="[METRIC]...", shell_complete=complete_metric)
@click.option(
    "--format",
    "output_format",
    type=click.Choice(["text", "json", "markdown"]),
    default="text",
    show_default=True,
    help="The output format.",
)
def command(names: tuple[str, ...], output_format: str) -> int:
    """List the metrics that the requirements of a spec can name.

    With METRIC, such as latency.p99, only these, with their definition.
    """
    from r2bspec.measure import metric_catalogue as reference
    from r2bspec.measure.metric_catalogue import METRICS, MetricError

    try:
        infos = [reference.find_metric(name) for name in names] or list(METRICS.values())
    except MetricError as error:
        meant = f"did you mean {error.suggestion}? " if error.suggestion else ""
        raise UsageError(str(error), hint=f"{meant}'r2bspec metrics' lists all") from error
    if output_format == "json":
        import msgspec

        content = msgspec.json.encode([reference.as_builtins(info) for info in infos])
        echo_document(msgspec.json.format(content, indent=2))
    elif output_format == "markdown":
        echo_document(reference.markdown_page(), nl=False)
    elif names:
        echo("\n\n".join("\n".join(_definition(name)) for name in names))
    else:
        echo("\n".join(_overview()))
    return ExitStatus.OK


def explain_metric(name: str) -> list[str]:
    """The lines about a metric; none if there is no metric of this name."""
    from r2bspec.measure.metric_catalogue import MetricError

    try:
        return list(_definition(name))
    except MetricError:
        return []


def _overview() -> Iterator[str]:
    from r2bspec.measure import metric_catalogue as reference
    from r2bspec.measure.metric_catalogue import METRICS

    width = max(map(len, METRICS))
    for number, (_, infos) in enumerate(reference.groups()):
        if number:
            yield ""
        for info in infos:
            where = _shown_modes(reference.modes(info))
            yield f"{info.name:<{width}}  {info.unit:<6} {info.description}{where}".rstrip()
    yield ""
    yield "Other percentiles can be named, too: latency.p42, latency.p99_5 for 99.5 %."
    yield "'r2bspec metrics METRIC' shows the definition of one."


def _shown_modes(modes: tuple[str, ...]) -> str:
    """The modes in which a metric is known, where these are not all."""
    from r2bspec.measure.metric_catalogue import MODES

    missing = [mode for mode in MODES if mode not in modes]
    return f" (not {' or '.join(missing)})" if missing else ""


def _definition(name: str) -> Iterator[str]:
    from r2bspec.measure import metric_catalogue as reference

    info = reference.find_metric(name)
    meant = reference.definition(info)
    yield f"{info.name}: {info.description}"
    yield ""
    yield from textwrap.wrap(meant.text, _WIDTH)
    yield ""
    for title, value in (
        ("formula", meant.formula),
        ("unit", info.unit or "none"),
        ("measured for", reference.SCOPES[info.scope]),
        ("modes", ", ".join(reference.modes(info))),
        ("judged by", reference.JUDGED[info.statistic]),
        ("requirement", reference.example_requirement(info)),
    ):
        indent = " " * 14
        yield textwrap.fill(f"{title:<14}{value}", _WIDTH, subsequent_indent=indent)
