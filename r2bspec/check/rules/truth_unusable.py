"""A monitor's truth that its recording does not have, or that its messages cannot have."""

from __future__ import annotations

from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    did_you_mean,
    quote,
    quoted_list,
)
from r2bspec.datasets.catalogue import TruthNames, truth_names
from r2bspec.language.spec import Monitor, Truth
from r2bspec.measure.metric_catalogue import TRUTHS


def _find(context: Context) -> Findings:
    for name, monitor in context.spec.monitors.items():
        if monitor.truth is None:
            continue
        found = _wrong_use(context, name, monitor) or _wrong_name(context, name, monitor.truth)
        if found is not None:
            yield found


def _wrong_use(context: Context, name: str, monitor: Monitor) -> Finding | None:
    truth = monitor.truth
    assert truth is not None  # noqa: S101 - the caller looks
    if context.spec.live:
        return Finding(
            message="'truth' has no effect with 'mode: live', in which nothing recorded is played",
            path=("monitors", name, "truth"),
            key=True,
            help="remove it",
        )
    wanted = TRUTHS[truth.kind].format
    if monitor.format != wanted:
        return Finding(
            message=f"messages of type {monitor.format} cannot be compared with a {truth.kind}",
            path=("monitors", name, "truth", "kind"),
            help=f"'kind: {truth.kind}' is for {wanted}",
        )
    return None


def _wrong_name(context: Context, name: str, truth: Truth) -> Finding | None:
    """A name that no recording has; nothing is said where one of them cannot be looked at."""
    recordings = context.recordings
    if not recordings or any(each.location is None for each in recordings):
        return None
    topics = tuple(context.spec.data_loader.topics)
    found = [truth_names(each.location, topics) for each in recordings if each.location]
    known = [each for names in found if names for each in _of_kind(names, truth)]
    if truth.name in known or f"/{truth.name}" in known:
        return None
    path = ("monitors", name, "truth", "name")
    if not any(found):
        return Finding(
            message="the recording has no ground truth",
            path=path,
            help="remove 'truth', or use a synthetic dataset",
        )
    what = TRUTHS[truth.kind].named
    close = did_you_mean(truth.name, known)
    advice = f"known: {quoted_list(known)}" if known else "load the images that it is about"
    return Finding(
        message=f"the ground truth has no {truth.kind} of {quote(truth.name)}",
        path=path,
        help=f"did you mean {quote(close)}?" if close else f"it is the name of {what}; {advice}",
    )


def _of_kind(names: TruthNames, truth: Truth) -> tuple[str, ...]:
    return names.disparity if truth.kind == "disparity" else names.tag


RULE = Rule(code="R2B416", find=_find)
