"""A space of deployments as text: levers, settings, and what is left out."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from r2bspec.diagnostics.quote import pluralize
from r2bspec.plan.tuning_space import Lever, Setting, TuningSpace

_WIDTH = 100


def space_text(space: TuningSpace) -> str:
    """The levers, each with its settings, today's first; then what is left out and why."""
    return "".join(f"{line}\n" for line in _lines(space))


def _lines(space: TuningSpace) -> Iterator[str]:
    yield (
        f"{pluralize(space.size, 'deployment')}, today's among them, of "
        f"{pluralize(len(space.levers), 'lever')}; today's setting comes first"
    )
    yield ""
    deciding = {name for lever in space.levers for name in lever.only_with}
    for lever in space.levers:
        texts = [_setting(each) for each in lever.settings]
        if lever.name in deciding:
            yield lever.name
            yield from (f"  {place}: {text}" for place, text in enumerate(texts))
            continue
        line = f"{lever.name}: {' | '.join(texts)}{_condition(lever)}"
        yield from textwrap.wrap(line, _WIDTH, subsequent_indent="    ", break_on_hyphens=False)
    if space.left_out:
        yield ""
        yield "Left out:"
        for reason in space.left_out:
            yield from textwrap.wrap(reason, _WIDTH, initial_indent="  ", subsequent_indent="    ")


def _setting(setting: Setting) -> str:
    return f"{setting.text} ({setting.for_others})" if setting.for_others else setting.text


def _condition(lever: Lever) -> str:
    """The settings of other levers with which it has an effect, by their numbers."""
    conditions = (f"{name} {', '.join(map(str, at))}" for name, at in lever.only_with.items())
    return "".join(f"; with {condition} only" for condition in conditions)
