"""The rows of the anatomy of a run, for every report with tables: paths by parts, and nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import msgspec

from r2bspec.diagnostics.quote import pluralize
from r2bspec.judge.measure.anatomy_blockers import Blocker
from r2bspec.judge.measure.anatomy_summary import AnatomySummary, PartSummary, PathSummary
from r2bspec.judge.measure.units import at_rate, show
from r2bspec.judge.result import Result

PART_COLUMNS: Final = ("where", "part", "p50", "p99", "share", "slowest")
NODE_COLUMNS: Final = (
    *("node", "load", "threads", "taken", "never taken"),
    *("callback p50", "callback p99", "wait p50", "wait p99"),
)
NODES_CAPTION: Final = (
    "callbacks are whole here, and in paths end with the publication; a load of 100 % is one "
    "thread in callbacks"
)

_SMALL: Final = 0.01
"""Parts with a smaller share of the latency are left out of tables, together."""


def anatomies_of(result: Result) -> tuple[AnatomySummary, ...]:
    """Return the anatomies of a result; most results have none."""
    return () if result.anatomies is msgspec.UNSET else result.anatomies


def title(anatomy: AnatomySummary, path: PathSummary) -> str:
    """Return a path as a title, such as ``player → /in → blur → /out → out at 30 Hz``."""
    at = f" {at_rate(anatomy.rate_hz)}" if anatomy.rate_hz else ""
    return f"{' → '.join((*path.hops, path.monitor))}{at}"


def caption(path: PathSummary) -> str:
    """Return how many messages a path has, and how they came."""
    texts = [f"{path.n:,} message{'s' if path.n != 1 else ''}"]
    if path.last < path.n:
        texts.append(f"{path.last:,} of them came after the other inputs that they needed")
    if path.by_timer:
        texts.append(f"a timer or a thread of a node published {path.by_timer:,}")
    return "; ".join([*texts, "p50 and p99 do not add up, means and the slowest do"])


def part_rows(path: PathSummary) -> Iterator[tuple[str, ...]]:
    """Yield a row for each part with a share, and one for the whole; see `PART_COLUMNS`."""
    small = [part for part in path.parts if not is_shown(part, path)]
    # A single one takes no more room than a row that stands for it.
    small = small if len(small) > 1 else []
    for part in path.parts:
        if part not in small:
            times = (show(part.p50, "s"), show(part.p99, "s"))
            yield (part.owner, part.name, *times, share(part.share), show(part.slowest, "s"))
    if small:
        slowest = sum(part.slowest or 0.0 for part in small)
        shares = share(sum(part.share for part in small))
        yield (f"{len(small)} others", "", "", "", shares, show(slowest, "s"))
    yield (
        *("whole path", "", show(path.p50, "s"), show(path.p99, "s")),
        *(share(1.0), show(path.slowest, "s")),
    )


def is_shown(part: PartSummary, path: PathSummary) -> bool:
    """Return whether a part is large enough for a row of its own."""
    return part.share >= _SMALL or (part.p99 or 0.0) >= _SMALL * (path.p99 or 0.0)


def share(value: float) -> str:
    """Return a share in percent, with a decimal below ten."""
    return f"{value * 100:.0f} %" if value >= 0.1 else f"{value * 100:.1f} %"


def node_rows(anatomy: AnatomySummary) -> Iterator[tuple[str, ...]]:
    """Yield a row for each node; see `NODE_COLUMNS`."""
    for node in anatomy.nodes:
        yield (
            node.name,
            share(node.load),
            str(node.threads),
            f"{node.taken:,}",
            f"{node.overtaken:,}",
            *(show(node.callback_p50, "s"), show(node.callback_p99, "s")),
            *(show(node.wait_p50, "s"), show(node.wait_p99, "s")),
        )


def blocker_text(blocker: Blocker) -> str:
    """Return for which callback messages wait, and why, as a sentence without a full stop."""
    where = "" if blocker.by_node == blocker.node else f" of {blocker.by_node}"
    is_own = (blocker.by_node, blocker.by) == (blocker.node, blocker.topic)
    if not blocker.by:
        every = f" (every {show(blocker.period, 's')})" if blocker.period else ""
        callback = f"a timer{where or ' of the same node'}{every}"
    elif is_own:
        callback = "the callback of the messages before"
    else:
        callback = f"the callback of {blocker.by}{where}"
    text = (
        f"{blocker.topic} waits at {blocker.node} for {callback}: {share(blocker.share)} of the "
        f"wait, {show(blocker.mean, 's')} on average for {pluralize(blocker.n, 'message')}"
    )
    if blocker.threads == 1 and not is_own:
        text += "; one thread calls both"
    elif not where and not is_own:
        text += (
            f"; of {blocker.threads} threads none calls both at once: they are in one mutually "
            "exclusive callback group, such as the default group of a node"
        )
    return text


def anatomy_notes(anatomy: AnatomySummary) -> Iterator[str]:
    """Yield a sentence, without a full stop, on each callback that blocks and each missing part."""
    yield from map(blocker_text, anatomy.blockers)
    if anatomy.error:
        yield anatomy.error.rstrip(".")
    for monitor, received in anatomy.received.items():
        with_path = sum(path.last for path in anatomy.paths if path.monitor == monitor)
        if with_path < received:
            what = f"{received - with_path:,} of {received:,} messages of {monitor} have no"
            if anatomy.only:
                names = ", ".join(anatomy.only)
                yield f"{what} known path, because only {names} was to be observed"
            else:
                yield f"{what} path to an input that is known"
