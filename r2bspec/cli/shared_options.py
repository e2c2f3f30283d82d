"""Options that several verbs share, and the types of their values."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from r2bspec.cli.completion import complete_case, complete_report, complete_variable
from r2bspec.language.quantities import Duration, Quantity, QuantityError
from r2bspec.language.selected_spec import SelectionValues
from r2bspec.safe_io.limits import MAX_PLANNED_ITERATIONS

if TYPE_CHECKING:
    from r2bspec.report.write_reports import ReportRequest


Command = TypeVar("Command", bound=Callable[..., Any])


class QuantityType(click.ParamType):  # type: ignore[type-arg, unused-ignore]
    """A quantity with its unit, within limits; the error for a bare number proposes the unit."""

    def __init__(self, kind: type[Quantity], lowest: str, highest: str) -> None:
        self.name = kind.kind
        self._kind = kind
        self._lowest, self._highest = kind.parse(lowest), kind.parse(highest)

    def convert(
        self, value: object, param: click.Parameter | None, ctx: click.Context | None
    ) -> Quantity:
        """Return the quantity of a text; a quantity stays as it is."""
        if isinstance(value, Quantity):
            return value
        try:
            quantity = self._kind.parse(str(value))
        except QuantityError as error:
            proposal = f"; for example '{error.suggestion}'" if error.suggestion else ""
            self.fail(f"{error}{proposal}", param, ctx)
        if quantity < self._lowest or quantity > self._highest:
            self.fail(f"{quantity} is not between {self._lowest} and {self._highest}", param, ctx)
        return quantity

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """Return the placeholder of the value in the help."""
        del param, ctx
        return self.name.upper()


FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)


_MAX_LISTED_SPECS = 5


class _SpecPath(click.Path):
    """A path to one spec; a folder is answered with the specs in it."""

    def __init__(self) -> None:
        super().__init__(path_type=Path)

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Return the path."""
        from r2bspec.safe_io.safe_file import is_folder

        path = Path(os.fsdecode(super().convert(value, param, ctx)))
        if is_folder(path):
            specs = sorted(path.glob("*.r2b.yaml"))[:_MAX_LISTED_SPECS]
            others = f", such as {', '.join(map(str, specs))}" if specs else ""
            self.fail(f"{str(path)!r} is a folder: name one spec{others}", param, ctx)
        return path


spec_argument = click.argument("spec", type=_SpecPath())

quiet_option = click.option("--quiet", "-q", is_flag=True, help="Show no progress.")


def format_option(*formats: str) -> Callable[[Command], Command]:
    """Return the option ``--format``, passed as `output_format`.

    Its choices are text and JSON if none are named.
    """
    return click.option(
        "--format",
        "output_format",
        type=click.Choice(formats or ("text", "json")),
        default="text",
        show_default=True,
        help="The output format.",
    )


def flag_options(texts: dict[str, str]) -> Callable[[Command], Command]:
    """Return options without a value, by their names, each with its line in the help."""

    def decorate(command: Command) -> Command:
        for name, text in reversed(texts.items()):
            command = click.option(name, is_flag=True, help=text)(command)
        return command

    return decorate


def repeatable_option(*names: str, **settings: Any) -> Callable[[Command], Command]:
    """Return an option that may be repeated, which its help says; its values are a tuple."""
    settings["help"] += "; may be repeated."
    return click.option(*names, multiple=True, **settings)


def duration(lowest: str, highest: str) -> QuantityType:
    """Return the type of an option that takes a duration."""
    return QuantityType(Duration, lowest, highest)


wait_option = click.option(
    "--wait",
    type=duration("0 s", "168 h"),
    help="How long to wait while this host runs other benchmarks.  [default: until they have run]",
)


def queue_options(command: Command) -> Command:
    """Add the options for the time in which this host runs other benchmarks."""
    flags = {"--no-lock": "Run even while this host runs a benchmark."}
    return wait_option(flag_options(flags)(command))


output_option = click.option(
    "--output",
    "-o",
    type=FOLDER,
    help="The folder of the runs, new or empty.  [default: runs/NAME-TIME]",
)

pairs_option = click.option(
    "--pairs",
    type=click.IntRange(min=1, max=MAX_PLANNED_ITERATIONS),
    help="The most pairs of runs, or starts of both sides, to play.  "
    "[default: benchmark.iterations; by turns 12]",
)

against_option = repeatable_option(
    "--against",
    metavar="REF",
    help="The base: another spec, var:NAME=VALUE, set:PATH=VALUE, or env: with a setup file, an "
    "installed workspace or NAME=VALUE",
)


def suite_options(command: Command) -> Command:
    """Add the options that select among several specs."""
    for decorate in (
        flag_options(
            {
                "--smoke": "One short iteration that shows whether all works; no verdict.",
                "--resume": "Run only what the folder of --output does not have yet.",
                "--fail-fast": "End after the first run that does not pass.",
            }
        ),
        repeatable_option(
            "--scan",
            metavar="NAME=VALUE,...",
            help="A run for each value of a variable, or of a key such as transport",
        ),
    ):
        command = decorate(command)
    return command


sets_option = repeatable_option(
    "--set",
    "sets",
    metavar="PATH=VALUE",
    help="Set a value of the spec, such as benchmark.iterations=3",
)

variables_option = repeatable_option(
    "--var",
    "variables",
    metavar="NAME=VALUE",
    shell_complete=complete_variable,
    help="Set a declared variable",
)

_case_option = click.option(
    "--case",
    default="",
    metavar="CASE",
    shell_complete=complete_case,
    help="The case of the matrix, such as threads=2; for 'run' also all.",
)


def parse_pairs(option: str, texts: Iterable[str]) -> dict[str, str]:
    """Return the values of an option that takes ``NAME=VALUE``.

    Raises:
        click.UsageError: one of them has no name, or no equals sign.
    """
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise click.UsageError(f"{option} takes NAME=VALUE, not {text!r}")
        pairs[name] = value
    return pairs


def spec_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add the options of a spec to a verb, which takes them as `values`, its `SelectionValues`."""

    @sets_option
    @variables_option
    @_case_option
    @functools.wraps(command)
    def with_values(
        sets: tuple[str, ...],
        variables: tuple[str, ...],
        case: str,
        **others: Any,
    ) -> int:
        values = SelectionValues(
            sets=sets,
            variables=parse_pairs("--var", variables),
            case=case,
        )
        return command(values=values, **others)

    return with_values


def _parse_reports(
    _ctx: click.Context, _param: click.Parameter, options: tuple[str, ...]
) -> tuple[ReportRequest, ...]:
    if not options:
        return ()
    from r2bspec.report.write_reports import parse_report_requests

    return parse_report_requests(options)


reports_option = click.option(
    "--report",
    "reports",
    multiple=True,
    metavar="FORMAT=PATH",
    callback=_parse_reports,
    shell_complete=complete_report,
    help="Write a report, such as html=report.html, or markdown=- for standard output; may be "
    "repeated. 'r2bspec docs reports' lists the formats.",
)


verbose_option = click.option(
    "--verbose",
    is_flag=True,
    help="The reason of each requirement, and all notes; without it a report has five.",
)


def result_options(*formats: str) -> Callable[[Command], Command]:
    """Add the options of all verbs that play and report, with the formats of their output."""

    def decorate(command: Command) -> Command:
        for option in (reports_option, verbose_option, quiet_option, format_option(*formats)):
            command = option(command)
        return command

    return decorate
