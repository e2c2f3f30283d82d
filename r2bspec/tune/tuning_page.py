"""The page of a search for a deployment: what it costs and what it misses, every trial in one view.

It is self-contained like the other pages (`r2bspec.report.html`), and has no script: its numbers
are in tables, its drawings are inline SVG.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Final

from r2bspec.diagnostics.quote import clip, printable
from r2bspec.report.html import chart
from r2bspec.report.html.templates import own_style, render_template
from r2bspec.tune import tuning_texts as wording
from r2bspec.tune.tuning_result import Gain, Trial, TrialState, TuningResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FURTHEST: Final = 4.0
"""Of a limit; what is further beyond, such as lost messages, is drawn there."""

_LOGARITHMIC_FROM: Final = 2.0
"""The ratio of the furthest requirements from which on their axis is logarithmic: on a shorter one
it would have a single number."""

_BAR_IN: Final = 0.28
_FRAME_IN: Final = 0.9
_MAX_NAME: Final = 60
_COLOURS: Final[dict[TrialState, str]] = {"meets": "good", "misses": "bad", "open": "unsure"}
_MARKS: Final[dict[TrialState, str]] = {"meets": "o", "misses": "X", "open": "D"}
_OUTCOMES: Final = {
    "improved": "pass",
    "meets": "pass",
    "met today": "",
    "not met": "fail",
    "not shown": "inconclusive",
    "incomplete": "inconclusive",
}
_SCALES: Final = {"share": (100.0, "%"), "s": (1e3, "ms"), "B": (1 / 2**20, "MiB")}
"""How a unit is drawn: the factor, and its name."""

_STATES: Final = {"meets": "pass", "misses": "fail", "open": "inconclusive"}


def to_html(result: TuningResult) -> bytes:
    """The page, UTF-8. The same result gives the same bytes."""
    from markupsafe import Markup

    charts = [
        # Serialised from a tree, which escapes every text.
        {"title": made.title, "note": made.note, "svg": Markup(made.svg)}  # noqa: S704
        for made in _charts(result)
    ]
    context = {
        "line": wording.headline(result),
        "result": result,
        "outcome": _OUTCOMES[result.outcome],
        "facts": wording.facts(result),
        "winner_title": wording.winner_title(result),
        "winner": list(wording.winner_lines(result)),
        "gain_header": wording.gain_header(result),
        "gain_tables": list(wording.gain_tables(result)),
        "trial_header": wording.TRIAL_HEADER,
        "trials": [(_STATES.get(row.state, ""), row) for row in wording.trial_rows(result)],
        "remarks": list(wording.remarks(result)),
        "charts": charts,
        **own_style(),
    }
    return render_template("tuning_page.html.j2", context)


def _charts(result: TuningResult) -> Iterator[chart.Chart]:
    measured = [
        trial
        for trial in result.trials
        if trial.state in _MARKS and trial.margins and trial.cost is not None
    ]
    if measured:
        yield _trade_off(result, measured)
    gains = [gain for gain in (*result.levers, *result.dropped) if gain.ratio]
    if gains:
        yield _levers(gains, result)


def _trade_off(result: TuningResult, measured: Sequence[Trial]) -> chart.Chart:
    description = (
        f"{result.goal} of {len(measured)} deployments against their furthest requirement, as a "
        "share of its limit. Left of the line at 100 % every requirement is met. The stepped line "
        "joins the deployments of which no other is better in both."
    )

    def paint(sketch: chart.ChartBuilder) -> None:
        axes = sketch.figure.subplots()
        scale, unit = _SCALES.get(result.goal_unit, (1.0, result.goal_unit))
        points = {trial.number: _point(trial, scale) for trial in measured}
        axes.axvline(100, color=chart.PALETTE["ink"], linewidth=0.8, linestyle=(0, (4, 3)))
        front = _pareto(list(points.values()))
        axes.step(*zip(*front, strict=True), where="post", color=chart.PALETTE["s0"], linewidth=1)
        for state in _MARKS:
            seen = [points[trial.number] for trial in measured if trial.state == state]
            if seen:
                ink = chart.PALETTE[_COLOURS[state]]
                label = wording.STATE_WORDS[state].partition(" ")[2]
                axes.scatter(*zip(*seen, strict=True), color=ink, marker=_MARKS[state], label=label)
        places = [place for place, _ in points.values()]
        if max(100, *places) > _LOGARITHMIC_FROM * min(100, *places):
            axes.set_xscale("log")
            chart.plain_numbers(axes.xaxis)
        axes.margins(x=0.12, y=0.15)
        axes.set_xlabel("furthest requirement, % of its limit")
        axes.set_ylabel(printable(clip(f"{result.goal}, {unit}", _MAX_NAME)))
        # Above: deployments may be anywhere, and those that lose messages are at the right end.
        axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=len(_MARKS))
        _mark(axes, result, measured, points, set(front))
        sketch.note = " ".join(_notes(result, measured))

    return chart.draw("trade-off", "What each deployment costs and misses", description, 3.8, paint)


def _point(trial: Trial, scale: float) -> tuple[float, float]:
    beyond = math.exp(min(trial.excess, math.log(_FURTHEST)))
    return 100 * beyond, (trial.cost or 0.0) * scale


def _notes(result: TuningResult, measured: Sequence[Trial]) -> Iterator[str]:
    yield "Numbers are those of the table; the stepped line joins what nothing else is better than."
    if any(math.exp(min(trial.excess, 99)) > _FURTHEST for trial in measured):
        yield f"What is beyond {100 * _FURTHEST:.0f} % is drawn there."
    if missing := len(result.trials) - len(measured):
        yield f"{missing} without a measurement are in the table only."


def _mark(
    axes: Axes,
    result: TuningResult,
    measured: Sequence[Trial],
    points: dict[int, tuple[float, float]],
    front: set[tuple[float, float]],
) -> None:
    """Name today's deployment and the proposed one, and number those of the front."""
    ink = chart.PALETTE["ink"]
    for trial in measured:
        at = points[trial.number]
        is_winner = result.is_proved and trial.deployment == result.winner
        if trial.number == 0 or is_winner:
            axes.scatter(*at, s=110, facecolors="none", edgecolors=ink, linewidths=1.2)
            if trial.number == 0:
                chart.write(axes, "today", at, (-8, -4), ink, ha="right")
            else:
                chart.write(axes, f"{trial.number}, proposed", at, (8, -4), ink)
        elif at in front:
            chart.write(axes, str(trial.number), at, (0, -12), chart.PALETTE["quiet"], ha="center")


def _pareto(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """The points of which no other is left of and below, from left to right."""
    front: list[tuple[float, float]] = []
    for point in sorted(points):
        if not front or point[1] < front[-1][1]:
            front.append(point)
    return front


def _levers(gains: Sequence[Gain], result: TuningResult) -> chart.Chart:
    shown = [result.proof, *gains] if result.proof and result.proof.ratio else gains
    interval = wording.interval_title(result)
    description = (
        f"The change of {result.goal} by each lever, with its {interval}; left of 0 is less."
    )

    def paint(sketch: chart.ChartBuilder) -> None:
        axes = sketch.figure.subplots()
        axes.axvline(0, color=chart.PALETTE["ink"], linewidth=0.8)
        for place, gain in enumerate(shown):
            middle = _change(gain.ratio)
            lower, upper = (_change(gain.lower), _change(gain.upper))
            ink = chart.PALETTE["good" if gain.is_shown else "quiet"]
            axes.hlines(place, lower, upper, color=ink, linewidth=2.4)
            axes.plot([middle], [place], "o", color=ink)
            text = wording.change_text(gain)
            chart.write(axes, text, (middle, place), (0, 5), ink, ha="center")
        names = [printable(clip(gain.lever or "all of them", _MAX_NAME)) for gain in shown]
        axes.set_yticks(range(len(shown)), labels=names)
        axes.set_ylim(len(shown) - 0.4, -0.8)
        axes.grid(axis="y", visible=False)
        axes.set_xlabel(printable(clip(f"change of {result.goal}, %", _MAX_NAME)))

    height_in = _FRAME_IN + _BAR_IN * len(shown)
    return chart.draw("levers", "What each lever gives", description, height_in, paint)


def _change(ratio: float | None) -> float:
    return 100 * (min(ratio, _FURTHEST) - 1) if ratio is not None else math.nan
