"""Clocks: the clock of the stamps, and the publisher of the time of a graph on /clock."""

from __future__ import annotations

from r2bspec.check.check_context import Context, clocks_ahead
from r2bspec.check.rule import Finding, Findings, Pointer, rule, value_key
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote
from r2bspec.language.quantities import Duration
from r2bspec.plan.nearest_stamps import LONGEST_DELAY_NS
from r2bspec.plan.wiring.wiring import NodeWiring

_CLOCK = "/clock"
_CLOCK_PARAMETER = "use_sim_time"


@rule("R2B233")
def clock_without_publisher(context: Context) -> Findings:
    """Find nodes that wait for /clock, which nothing publishes."""
    if context.spec.playback.clock:
        return
    for phase in context.wiring.phases:
        for node in phase.nodes:
            place = _clock_setting(context, node)
            if place is None or phase.publishers(_CLOCK):
                continue
            path, key = place
            # Another node may publish it where its publishers are unknown.
            certain = all(publisher is node for publisher in phase.possible_publishers)
            yield Finding(
                message=f"{node.key} has {quote('use_sim_time: true')} and waits for /clock, "
                f"which nothing {'' if certain else 'known '}publishes",
                path=path,
                key=key,
                help="remove it, or let a node publish /clock"
                if context.spec.live
                else "write 'playback: {clock: true}' to publish it, or remove the parameter",
                severity=None if certain else "info",
            )


def _clock_setting(context: Context, node: NodeWiring) -> tuple[Path, bool] | None:
    """Return where a node is told to use /clock, and whether the key is meant.

    None if it is not.
    """
    if node.parameters.get(_CLOCK_PARAMETER) is True:
        path = context.parameter_path(node, _CLOCK_PARAMETER)
        return (path, False) if path is not None else ((*node.path, "parameters"), True)
    launch = node.node.launch
    given = launch.arguments.get(_CLOCK_PARAMETER) if launch is not None else None
    if str(given).lower() == "true":
        return (*node.path, "launch", "arguments", _CLOCK_PARAMETER), False
    return None


@rule("R2B243")
def clock_published_twice(context: Context) -> Findings:
    """Find publishers of /clock besides the harness, and clocks that disagree with the stamps."""
    playback = context.spec.playback
    stamped = any(played.timestamp == "header" for played in playback.played.values())
    publishers = context.wiring.measure.publishers(_CLOCK)
    for publisher in publishers:
        if playback.clock:
            message = "'playback: {clock: true}' and this both publish /clock"
            advice = "keep one of them: nodes that use /clock jump between two clocks"
        elif publisher.owner == "player" and stamped:
            message = "the recorded /clock is played, but the stamps are of the time of playing"
            advice = "write 'playback: {clock: true}' instead, which publishes that time on /clock"
        else:
            continue
        yield Finding(
            message=message,
            path=publisher.path,
            key=publisher.topic_is_key,
            help=advice,
            related=(Pointer("published here", ("playback", "clock")),) if playback.clock else (),
        )


@rule("R2B327")
def stamps_of_another_clock(context: Context) -> Findings:
    """Find recorded stamps that were never set, or are of another clock than the recording."""
    times = context.first_times
    alike: dict[tuple[str, str], list[str]] = {}
    for name, found in times.items():
        played = context.spec.playback.played[name]
        # Of several inputs it matters how their clocks differ.
        if found.clock == "same" or (found.clock == "other" and len(times) > 1):
            continue
        if not played.clock_ahead.ns:
            alike.setdefault((found.clock, played.timestamp), []).append(name)
    for (clock, timestamp), (first, *others) in alike.items():
        place = ("playback", "inputs", first)
        is_kept = timestamp == "none"
        likewise = f"; likewise {', '.join(map(quote, others))}" if others else ""
        yield Finding(
            message=f"{quote(first)} {times[first].clock_text}{likewise}",
            path=(*place, "timestamp") if is_kept else place,
            key=not is_kept,
            help="without 'timestamp: none' the player writes the time of playing into the headers"
            if is_kept
            else "the player writes the time of playing into the headers; "
            + _while_playing(clock, publishes_clock=context.spec.playback.clock),
            severity="warning" if is_kept else None,
            suppressed_by={value_key(("data_loader", "window"))},
        )
    for name, ahead in _clocks_apart(context).items():
        yield Finding(
            message=f"the clock of {quote(name)} was {ahead} ahead of that of other inputs, which "
            "are played at the times of their stamps",
            path=("playback", "inputs", name),
            key=True,
            help=f"write 'clock_ahead: {ahead}'",
            severity="warning",
            suppressed_by={value_key(("data_loader", "window"))},
        )


def _while_playing(clock: str, *, publishes_clock: bool) -> str:
    """Return what else a user has to know of stamps of this clock."""
    if clock in {"stuck", "partly"}:
        return "messages without different stamps are paired in the order of recording"
    if clock == "paced":
        return "timelines and 'rate: recorded' are played at the times of recording"
    gets = "nodes with 'use_sim_time' get that time on /clock"
    return gets if publishes_clock else f"with 'playback: {{clock: true}}' {gets}"


def _clocks_apart(context: Context) -> dict[str, Duration]:
    """Return how far the clocks of inputs are ahead that are not paired with others in steps."""
    playback = context.spec.playback
    moving = {name: times for name, times in context.input_times.items() if not times.is_stuck}
    ahead = clocks_ahead(moving, LONGEST_DELAY_NS)
    paired = [
        by
        for name, by in ahead.items()
        if playback.mode != "timeline" and playback.played[name].rate == "step"
    ]
    # R2B415 says how those in the steps differ from each other.
    least_ns = min((by.ns for by in paired), default=0)
    return {
        name: by for name, by in ahead.items() if by.ns and (by.ns == least_ns or by not in paired)
    }
