"""Inputs of which messages are not played, because they have no partner of the same stamp."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from r2bspec.check.message_types import begins_with_header
from r2bspec.check.rule_api import (
    Context,
    Finding,
    Findings,
    Rule,
    value_key,
)
from r2bspec.check.window_counts import window_message_counts
from r2bspec.plan.nearest_stamps import pair_nearest
from r2bspec.plan.topic_plans import direct_bag_topic
from r2bspec.record.run_record import UNPAIRED_HELP, UnplayedMessages

_MAX_READ_BYTES = 64 << 20
"""Stamps of larger bags are not read; the counts of their messages are compared."""

_COUNTS_ALONE = "; only their numbers were compared, not their stamps"


def _find(context: Context) -> Findings:
    spec = context.spec
    if spec.playback.mode == "timeline" or spec.playback.unpaired == "drop":
        return
    for one in _unplayed(context):
        if not one.is_warning:
            continue
        name = next(
            name for name in spec.playback.inputs if context.harness_topic(name) == one.topic
        )
        yield Finding(
            message=f"{one.clause}{_COUNTS_ALONE if one.at_least else ''}",
            path=("playback", "inputs", name),
            key=True,
            help=UNPAIRED_HELP,
            severity="error" if one.is_most else None,
            suppressed_by={value_key(("data_loader", "window"))},
        )


def _unplayed(context: Context) -> list[UnplayedMessages]:
    """At least so many messages of each input are not played, as far as the bag tells."""
    bag_topics: dict[str, str] = {}
    for name, each in context.spec.playback.inputs.items():
        if begins_with_header(each.format) is False or each.rate == "recorded":
            continue
        source = context.harness_topic(each.source)
        bag_topic = direct_bag_topic(source, context.spec, context.wiring)
        if not bag_topic or begins_with_header(each.format) is None:
            # What a preprocessor publishes, and with which stamps, only the run tells.
            return []
        bag_topics[context.harness_topic(name)] = bag_topic
    if len(bag_topics) < 2:
        return []
    stamps = _read_stamps(context, set(bag_topics.values()))
    if stamps is None:
        return _by_counts(context, bag_topics)
    slops_ns = _slops(context, bag_topics)
    steps = pair_nearest([stamps[each] for each in bag_topics.values()], slops_ns)
    return [
        UnplayedMessages(topic=topic, count=total - len(steps), total=total, slop_ns=max(slops_ns))
        for topic, bag_topic in bag_topics.items()
        if (total := len(stamps[bag_topic])) > len(steps)
    ]


def _slops(context: Context, topics: Iterable[str]) -> list[int]:
    """The slop of each of these inputs, in ns."""
    playback = context.spec.playback
    slops = {
        context.harness_topic(name): (each.pairing or playback.pairing).slop.ns
        for name, each in playback.inputs.items()
    }
    return [slops[topic] for topic in topics]


def _by_counts(context: Context, bag_topics: dict[str, str]) -> list[UnplayedMessages]:
    """An input with more messages than another has at least so many without a partner."""
    counts = window_message_counts(context)
    if not all(each in counts and counts[each].exact for each in bag_topics.values()):
        return []
    fewest = min(counts[each].messages for each in bag_topics.values())
    slop_ns = max(_slops(context, bag_topics))
    return [
        UnplayedMessages(
            topic=topic, count=total - fewest, total=total, at_least=True, slop_ns=slop_ns
        )
        for topic, bag_topic in bag_topics.items()
        if (total := counts[bag_topic].messages) > fewest > 0
    ]


def _read_stamps(context: Context, topics: set[str]) -> dict[str, list[int]] | None:
    """The header stamps in the window by bag topic; None if they are not read."""
    from r2bspec.bags.bag_reader import read_messages
    from r2bspec.bags.errors import DataError
    from r2bspec.bags.recording import Window
    from r2bspec.ipc.buffers import STAMP_BYTES, read_stamp

    path = context.bag_location.path if context.bag_location is not None else None
    if context.bag is None or path is None or _size(path) > _MAX_READ_BYTES:
        return None
    window = context.spec.data_loader.window
    wanted = Window(start_ns=window.start.ns, end_ns=window.end.ns if window.end else None)
    by_name = {each.lstrip("/"): each for each in topics}
    found: dict[str, list[int]] = {each: [] for each in topics}
    try:
        for message in read_messages(path, topics, wanted):
            if len(message.data) < STAMP_BYTES:
                return None
            found[by_name[message.topic.lstrip("/")]].append(read_stamp(message.data))
    except DataError:
        # Other rules report bags and windows that cannot be read.
        return None
    return found


def _size(path: Path) -> int:
    try:
        files = [each for each in path.iterdir() if each.is_file()] if path.is_dir() else [path]
        return sum(each.stat().st_size for each in files)
    except OSError:
        return _MAX_READ_BYTES + 1


RULE = Rule(code="R2B415", find=_find)
