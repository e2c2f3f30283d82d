"""The transport between processes: whether the middleware has it, and how much it carries."""

from __future__ import annotations

import os

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, rule
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote
from r2bspec.language.located_tree import ListNode
from r2bspec.language.quantities import Size
from r2bspec.middleware.middleware import RMW_VARIABLE, refuse_transport, selected_rmw
from r2bspec.plan.this_machine import SHARED_MEMORY, shared_memory_bytes
from r2bspec.plan.topic_plans import direct_bag_topic

_CAPACITY_BYTES_PER_S = {"udp": 250e6, "shared_memory": 3e9}
"""Bytes per second between two processes on one host. Estimates: a 2-core x86-64 machine carried
2.8 MB messages in 12 ms over UDP on the loopback, and a copy in and out of shared memory in 0.7 ms
to 1 ms."""


@rule("R2B627")
def rate_above_transport_capacity(context: Context) -> Findings:
    """Rates that exceed the capacity of the transport."""
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
        direct_bag_topic(context.harness_topic(played.source), context.spec, context.wiring)
        == bag_topic
        for played in context.spec.playback.inputs.values()
    )


@rule("R2B628")
def shm_segment_too_small(context: Context) -> Findings:
    """Shared memory segments that are too small for the largest message."""
    segment, bag = context.spec.transport.segment, context.bag
    if segment is None or bag is None:
        return
    for name in context.spec.data_loader.topics:
        info = bag.find(name)
        if info is None or not info.max_message_bytes:
            continue
        size = Size(info.max_message_bytes)
        # The transport accepts messages up to half the size of its segment.
        if segment.bytes < 2 * size.bytes:
            yield Finding(
                message=f"a segment of {segment} is too small for messages of {size} on "
                f"{quote(name)}",
                path=("transport", "segment"),
                help="remove 'segment': the default, 24 times the largest message, leaves room for "
                "the queues of the publishers",
                related=(Pointer("loaded here", ("data_loader", "topics", name)),),
            )
            return


@rule("R2B629")
def shared_memory_insufficient(context: Context) -> Findings:
    """Segments that need more shared memory than this machine has."""
    segment = context.spec.transport.segment
    if segment is None or context.spec.transport.kind != "shared_memory":
        return
    available_bytes = shared_memory_bytes()
    if available_bytes is None:
        return
    processes = len(context.processes)
    required_bytes = segment.bytes * processes
    if required_bytes > available_bytes:
        yield Finding(
            message=f"{processes} processes with a segment of {segment} each need "
            f"{Size(required_bytes)}, but {SHARED_MEMORY} has "
            f"{Size(available_bytes // 2**20 * 2**20)}",
            path=("transport", "segment"),
            help=f"reduce 'segment', or enlarge {SHARED_MEMORY} (docker run --shm-size)",
            machine_dependent=True,
        )


@rule("R2B666")
def transport_unsupported_by_middleware(context: Context) -> Findings:
    """A transport that cannot be configured with the middleware (RMW) that is selected."""
    transport = context.spec.transport.kind
    selected = {RMW_VARIABLE: os.environ.get(RMW_VARIABLE) or ""}
    refusal = refuse_transport(transport, selected_rmw(selected))
    if refusal is not None:
        default = "the default " if context.value_at(("transport",)) is None else ""
        yield Finding(
            message=f"{default}{refusal.message}, which {RMW_VARIABLE} selects here",
            path=("transport",),
            help=refusal.help,
            machine_dependent=True,
        )
    for _, node in context.nodes:
        refusal = refuse_transport(transport, selected_rmw(node.node.env))
        if refusal is not None:
            yield Finding(
                message=f"{refusal.message}, which this node loads",
                path=(*node.path, "env", RMW_VARIABLE),
                help=refusal.help,
            )
