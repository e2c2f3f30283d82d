"""Recordings: whether a bag can be used, and has what the data loader takes from it.

A bag that cannot be used is one finding with the code of its error; the other rules say nothing of
it then. Nothing here is said offline, where no bag is looked at.
"""

from __future__ import annotations

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, quoted_list, rule, suggestion, value_key
from r2bspec.diagnostics.quote import quote


@rule("R2B301")
def bag_not_found(context: Context) -> Findings:
    """Bags that do not exist or cannot be read; each finding has the code of its error."""
    for recording in context.recordings:
        error = recording.error
        if error is not None:
            yield Finding(message=str(error), path=recording.path, help=error.hint, code=error.code)


@rule("R2B306")
def serialization_not_cdr(context: Context) -> Findings:
    """Bag topics whose messages are not CDR."""
    if context.bag is None:
        return
    for name in context.spec.data_loader.topics:
        info = context.bag.find(name)
        if info is not None and info.serialization != "cdr":
            yield Finding(
                message=f"messages of {quote(name)} are serialised as {quote(info.serialization)}; "
                "only 'cdr' can be played",
                path=("data_loader", "topics", name),
                key=True,
                help="convert the bag with 'ros2 bag convert', where that format is installed",
            )


@rule("R2B308")
def topic_not_in_bag(context: Context) -> Findings:
    """Loaded topics that the bag does not contain."""
    bag = context.bag
    if bag is None:
        return
    for name in context.spec.data_loader.topics:
        if bag.find(name) is None:
            yield Finding(
                message=f"bag {quote(bag.name)} has no topic {quote(name)}",
                path=("data_loader", "topics", name),
                key=True,
                help=suggestion(name, bag.topics, "its topics"),
                suppresses={value_key(("data_loader", "topics", name))},
            )


@rule("R2B324")
def bag_unused(context: Context) -> Findings:
    """Bags of which no topic is loaded."""
    topics = context.spec.data_loader.topics
    if not context.spec.data_loader.bags or context.bag is None:
        return
    for recording in context.recordings:
        bag_index = recording.content
        if bag_index is not None and not any(bag_index.find(name) for name in topics):
            yield Finding(
                message=f"no topic of bag {quote(bag_index.name)} is loaded",
                path=recording.path,
                help=f"its topics: {quoted_list(bag_index.topics)}"
                if bag_index.topics
                else "the bag has no topics",
            )


@rule("R2B325")
def transforms_not_recorded(context: Context) -> Findings:
    """Transforms to publish that the bag does not contain."""
    loader, bag = context.spec.data_loader, context.bag
    if bag is None:
        return
    for name, is_published in (
        ("/tf", loader.publish_tf),
        ("/tf_static", loader.publish_tf_static),
    ):
        key = f"publish_{name[1:]}"
        if is_published and bag.find(name) is None:
            yield Finding(
                message=f"bag {quote(bag.name)} has no topic {quote(name)}",
                path=("data_loader", key),
                help=f"remove {quote(key)}, or publish the transforms from a node of the graph",
            )


@rule("R2B326")
def real_time_without_effect(context: Context) -> Findings:
    """Real-time loading without preprocessors."""
    if context.spec.data_loader.real_time and not context.spec.preprocessors:
        yield Finding(
            message="'real_time' has no effect without preprocessors",
            path=("data_loader", "real_time"),
            key=True,
            help="to play at the recorded times, set 'mode: timeline' under 'playback'",
        )
