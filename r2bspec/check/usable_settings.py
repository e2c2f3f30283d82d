"""The settings of a space of deployments with which a spec is valid.

What a rule finds is not known before a spec is loaded with a setting. Levers of different keys
rarely disturb each other, so one setting of each is tried at once; only where that is refused, each
is tried alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final

from r2bspec.check.check_context import Context, DocumentFiles
from r2bspec.check.engine import check, context_of
from r2bspec.diagnostics import Severity
from r2bspec.diagnostics.quote import first_words
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.plan.derive_space import PLACEMENT, derive_space
from r2bspec.plan.this_machine import SchedulingFacts
from r2bspec.plan.tuning_space import Lever, TuningSpace
from r2bspec.safe_io.limits import MAX_VARIED_VALUES

Refusal = Callable[[Sequence[str]], str]
"""Why a spec is not valid with further assignments; empty if it is."""

_NOT_SETTABLE: Final = "R2B127"
"""What is set is not in the document; it can only be made from what is."""


def usable_space(
    selection: SpecSelection,
    context: Context,
    facts: SchedulingFacts,
    *,
    largest_message_bytes: int = 0,
) -> TuningSpace:
    """The deployments of a spec, each setting of which leaves it valid.

    Args:
        selection: of the spec.
        context: of it; without errors.
        facts: as for `derive_space`.
        largest_message_bytes: likewise.
    """
    space = derive_space(
        context.spec, context.wiring, facts, largest_message_bytes=largest_message_bytes
    )
    files = DocumentFiles(context.loaded.base_dir, MAX_VARIED_VALUES)

    def refusal(sets: Sequence[str]) -> str:
        if not files.may_try(context.loaded):
            return "not checked, because the spec is large; name fewer in 'tune'"
        # Values of levers are tried here, and not once more by the rule that tries them.
        loaded = replace(selection, sets=(*selection.sets, *sets, "tune.values={}")).load()
        found = check(loaded, context=context_of(loaded, offline=context.offline, files=files))
        errors = [each for each in found if each.severity is Severity.ERROR]
        if any(each.code == _NOT_SETTABLE for each in errors):
            return "an instance of 'repeat' has no keys of its own; write it as a node to vary it"
        return f"{errors[0].code}: {errors[0].message}" if errors else ""

    return without_refused(space, refusal)


def without_refused(space: TuningSpace, refusal: Refusal) -> TuningSpace:
    """The space without settings that are refused, and which they are."""
    placement = next((lever for lever in space.levers if lever.name == PLACEMENT), None)
    refused: dict[tuple[str, int], str] = {}
    if placement is not None:
        refused |= dict(_refused_alone([placement], (), refusal))
    first: dict[int, list[Lever]] = {}
    for lever in space.levers:
        if lever is not placement:
            places = [
                place
                for place in lever.only_with.get(PLACEMENT, (0,))
                if (PLACEMENT, place) not in refused
            ]
            if places:
                first.setdefault(places[0], []).append(lever)
    for place, levers in first.items():
        sets = placement.settings[place].sets if placement is not None else ()
        refused |= dict(_refused_together(levers, sets, refusal))
    return _without(space, refused)


def _refused_together(
    levers: Sequence[Lever], sets: Sequence[str], refusal: Refusal
) -> Iterator[tuple[tuple[str, int], str]]:
    for place in range(1, max(len(lever.settings) for lever in levers)):
        having = [lever for lever in levers if place < len(lever.settings)]
        together = [each for lever in having for each in lever.settings[place].sets]
        if refusal((*sets, *together)):
            yield from _refused_alone(having, sets, refusal, only=place)


def _refused_alone(
    levers: Sequence[Lever], sets: Sequence[str], refusal: Refusal, *, only: int = 0
) -> Iterator[tuple[tuple[str, int], str]]:
    for lever in levers:
        for place in (only,) if only else range(1, len(lever.settings)):
            why = refusal((*sets, *lever.settings[place].sets))
            if why:
                yield (lever.name, place), why


def _without(space: TuningSpace, refused: dict[tuple[str, int], str]) -> TuningSpace:
    if not refused:
        return space
    kept = {
        lever.name: [
            place for place in range(len(lever.settings)) if (lever.name, place) not in refused
        ]
        for lever in space.levers
    }
    levers = []
    for lever in space.levers:
        only_with = {
            name: tuple(kept[name].index(place) for place in places if place in kept[name])
            for name, places in lever.only_with.items()
            # Of one setting that is left, today's, nothing depends.
            if len(kept[name]) > 1 or 0 not in places
        }
        settings = tuple(lever.settings[place] for place in kept[lever.name])
        if len(settings) > 1 and all(only_with.values()):
            levers.append(Lever(name=lever.name, settings=settings, only_with=only_with))
    return TuningSpace(levers=tuple(levers), left_out=(*space.left_out, *_reasons(space, refused)))


def _reasons(space: TuningSpace, refused: dict[tuple[str, int], str]) -> Iterator[str]:
    """Why settings are refused; those of one reason together."""
    texts = {lever.name: lever.settings for lever in space.levers}
    by_reason: dict[str, list[str]] = {}
    for (name, place), why in refused.items():
        by_reason.setdefault(why, []).append(f"{name} = {texts[name][place].text}")
    for why, settings in by_reason.items():
        yield f"{first_words(settings, 1)}: {why}"
