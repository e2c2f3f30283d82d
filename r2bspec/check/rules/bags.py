"""Recordings: whether a bag can be used, has what is loaded from it, and which part is played.

A bag that cannot be used is one finding with the code of its error; the other rules then say
nothing about it. Offline, no bag is examined, and nothing is reported here.
"""

from __future__ import annotations

from r2bspec.bags.recorded_parts import find_parts
from r2bspec.bags.recording import not_cdr
from r2bspec.check.check_context import Context, messages_in_window
from r2bspec.check.rule import Finding, Findings, Pointer, rule, value_key
from r2bspec.datasets.catalogue import DURATION_NS
from r2bspec.diagnostics.quote import quote, suggestion
from r2bspec.language.quantities import Duration


@rule("R2B301")
def bag_not_found(context: Context) -> Findings:
    """Find bags that do not exist or cannot be read; each finding has the code of its error."""
    for recording in context.recordings:
        error = recording.error
        if error is not None:
            yield Finding(message=str(error), path=recording.path, help=error.hint, code=error.code)


@rule("R2B308")
def topic_not_in_bag(context: Context) -> Findings:
    """Find loaded topics that the bag does not contain, or not as CDR."""
    bag = context.bag
    if bag is None:
        return
    for name in context.spec.data_loader.topics:
        info = bag.find(name)
        if info is not None and info.serialization != "cdr":
            error = not_cdr(f"bag {quote(bag.name)}", info)
            yield Finding(
                message=str(error),
                path=("data_loader", "topics", name),
                key=True,
                help=error.hint,
                code=error.code,
                suppresses={value_key(("data_loader", "topics", name))},
            )
        if info is None:
            yield Finding(
                message=f"bag {quote(bag.name)} has no topic {quote(name)}",
                path=("data_loader", "topics", name),
                key=True,
                help=suggestion(name, bag.topics, "its topics"),
                suppressed_by={value_key(("data_loader", "topics", name))},
                suppresses={value_key(("data_loader", "topics", name))},
            )

    loader = context.spec.data_loader
    for key, topic, is_published in (
        ("publish_tf", "/tf", loader.publish_tf),
        ("publish_tf_static", "/tf_static", loader.publish_tf_static),
    ):
        if is_published and bag.find(topic) is None:
            yield Finding(
                message=f"bag {quote(bag.name)} has no topic {quote(topic)}: no transforms of it "
                "are published",
                path=("data_loader", key),
                help="remove it, or take a recording with these transforms",
                severity="warning",
            )


_WINDOW = ("data_loader", "window")


@rule("R2B309")
def window_outside_bag(context: Context) -> Findings:
    """Find windows that extend beyond the bag."""
    bag, window = context.bag, context.spec.data_loader.window
    if bag is None or (window.end is not None and window.end.ns <= window.start.ns):
        return
    lasts_ns = _duration_ns(context)
    lasts = f"bag {quote(bag.name)} lasts {lasts_ns / 1e9:g} s"
    rendered = context.is_rendered
    if window.start.ns > lasts_ns:
        yield Finding(
            message=f"the window starts at {window.start}, but {lasts}",
            path=(*_WINDOW, "start"),
            help="window times count from the beginning of the bag",
            suppresses={value_key(_WINDOW)},
        )
    elif window.end is not None and window.end.ns > lasts_ns:
        yield Finding(
            message=f"the window ends at {window.end}, but {lasts}",
            path=(*_WINDOW, "end"),
            help=f"write {Duration(lasts_ns)}"
            if rendered
            else "remove 'end' to use the bag to its end",
            severity=None if rendered else "warning",
            suppresses={value_key(_WINDOW)} if rendered else set(),
        )


def _duration_ns(context: Context) -> int:
    """Return the latest end of a window: a rendered sequence lasts longer than its last message."""
    if context.is_rendered:
        return DURATION_NS
    return context.bag.duration_ns if context.bag is not None else 0


@rule("R2B320")
def window_end_before_start(context: Context) -> Findings:
    """Find windows that end before they start."""
    window = context.spec.data_loader.window
    if window.end is not None and window.end.ns <= window.start.ns:
        yield Finding(
            message=f"window end {window.end} is not after window start {window.start}",
            path=(*_WINDOW, "end"),
            help="both times count from the beginning of the bag; 'end' is not a length",
            related=(Pointer("window start", (*_WINDOW, "start")),),
            suppresses={value_key(_WINDOW)},
        )


@rule("R2B321")
def window_without_messages(context: Context) -> Findings:
    """Find loaded topics without messages in the window."""
    bag = context.bag
    window = context.spec.data_loader.window
    if bag is None or (window.end is not None and window.end.ns <= window.start.ns):
        return
    latched = {played.source for played in context.spec.playback.latched.values()}
    for name, number in messages_in_window(context).items():
        info = bag.find(name)
        if number or info is None:
            continue
        empty = info.count == 0
        first_ns, last_ns = info.span_ns or (bag.end_ns, bag.end_ns)
        start_ns = bag.start_ns + window.start.ns
        if first_ns < start_ns and context.spec.data_loader.topics[name] in latched:
            continue
        yield Finding(
            message=f"no messages of {quote(name)} in the bag"
            if empty
            else f"no messages of {quote(name)} in the window",
            path=("data_loader", "topics", name) if empty else _WINDOW,
            key=empty,
            help=""
            if empty
            else f"the last comes at {Duration(last_ns - bag.start_ns)}; 'rate: once' of the input "
            "plays it, as of a map"
            if last_ns < start_ns
            else f"the first of them comes at {Duration(first_ns - bag.start_ns)}"
            if first_ns > start_ns
            else f"the bag has {info.count:,} of them, {info.rate_hz:.3g} per second",
            suppressed_by={value_key(_WINDOW)},
            suppresses={value_key(("data_loader", "topics", name))},
        )


@rule("R2B324")
def window_with_gap(context: Context) -> Findings:
    """Find windows with a gap that is longer than the rest of it."""
    bag, window = context.bag, context.spec.data_loader.window
    if bag is None:
        return
    latched = {played.source for played in context.spec.playback.latched.values()}
    times = {
        topic: each
        for topic, each in (context.window_times or {}).items()
        if context.spec.data_loader.topics[topic] not in latched
    }
    parts = find_parts(bag, times, context.window)
    if parts is not None:
        yield Finding(
            message=f"the window has {parts.text}",
            path=_WINDOW if window.start.ns or window.end else ("data_loader",),
            key=not (window.start.ns or window.end),
            help=f"use one part: '{parts.window_text}'",
            suppressed_by={value_key(_WINDOW)},
        )


@rule("R2B323")
def buffer_of_one_message(context: Context) -> Findings:
    """Find buffers of one message."""
    playback = context.spec.playback
    if playback.buffer == 1 and playback.mode in {"looping", "sweeping"}:
        yield Finding(
            message="a buffer of one message repeats the same message",
            path=("playback", "buffer"),
            help="set 'buffer' to 10 or more, unless every message costs the same",
        )
