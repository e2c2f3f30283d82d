"""Confidences that are not between 50 % and 100 %."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule


def _find(context: Context) -> Findings:
    benchmark = context.spec.benchmark
    places: list[tuple[float | None, Path]] = [
        (benchmark.gate.confidence.fraction, ("benchmark", "gate", "confidence"))
    ]
    if benchmark.search is not None:
        places.append((benchmark.search.confidence.fraction, ("benchmark", "search", "confidence")))
    for name, objective in context.spec.slos.items():
        own = objective.confidence
        places.append((None if own is None else own.fraction, ("slos", name, "confidence")))
    for confidence, path in places:
        if confidence is not None and not 0.5 < confidence < 1:
            yield Finding(
                message=f"a confidence of {confidence * 100:g} % "
                + ("cannot be reached" if confidence >= 1 else "is no better than chance"),
                path=path,
                help="use 95 % or, for about 50 % more messages, 99 %",
                suppresses=frozenset(each.subject for each in context.requirements),
            )


RULE = Rule(code="R2B522", find=_find)
