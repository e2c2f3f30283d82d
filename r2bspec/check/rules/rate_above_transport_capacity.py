"""Rates that exceed the capacity of the transport."""

from __future__ import annotations

from r2bspec.check.rule_api import Context, Finding, Findings, Path, Rule
from r2bspec.language.located_tree import ListNode
from r2bspec.plan.topic_plans import direct_bag_topic

_CAPACITY_BYTES_PER_S = {"udp": 250e6, "shared_memory": 3e9}
"""Bytes per second between two processes on one host. Estimates: a 2-core x86-64 machine carried
2.8 MB messages in 12 ms over UDP on the loopback, and a copy in and out of shared memory in 0.7 ms
to 1 ms."""


def _find(context: Context) -> Findings:
    spec, bag = context.spec, context.bag
    capacity = _CAPACITY_BYTES_PER_S.get(spec.transport.kind)
    if capacity is None or bag is None or context.has_own_rate:
        return
    largest = max(
        (
            (info.max_message_bytes, name)
            for name in spec.data_loader.topics
            if (info := bag.find(name)) is not None and info.max_message_bytes
        ),
        default=(0, ""),
    )
    size, name = largest
    if not size or not _is_played_unchanged(context, name):
        return
    max_rate_hz = capacity / size
    for index, rate in enumerate(spec.benchmark.rates):
        if rate.hz > max_rate_hz:
            path: Path = ("benchmark", "rates", index)
            written = isinstance(context.value_at(("benchmark", "rates")), ListNode)
            yield Finding(
                message=f"{rate} of {name} is {rate.hz * size / 1e6:,.0f} MB/s, but "
                f"{spec.transport.kind} carries about {capacity / 1e6:,.0f} MB/s",
                path=path if written else ("benchmark", "rates"),
                help=f"use about {max_rate_hz:.0f} Hz (estimated on a machine with two cores)"
                + (", or 'transport: shared_memory'" if spec.transport.kind == "udp" else ""),
                machine_dependent=True,
            )
            if not written:
                return


def _is_played_unchanged(context: Context, bag_topic: str) -> bool:
    """Whether messages are played in their recorded size."""
    return any(
        direct_bag_topic(context.harness_topic(each.source), context.spec, context.wiring)
        == bag_topic
        for each in context.spec.playback.inputs.values()
    )


RULE = Rule(code="R2B627", find=_find)
