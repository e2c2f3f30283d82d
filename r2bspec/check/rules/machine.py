"""This machine, and the machine that a spec requires: CPUs, environment, memory, middleware."""

from __future__ import annotations

import os
from collections.abc import Iterator
from typing import Final

import msgspec

from r2bspec.check.check_context import Context
from r2bspec.check.rule import Finding, Findings, Pointer, rule
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.diagnostics.quote import quote, unknown_name_help
from r2bspec.language.located_tree import ListNode
from r2bspec.language.quantities import Size
from r2bspec.language.spec import ProcessSettings, Requires
from r2bspec.middleware.middleware import RMW_VARIABLE, refuse_transport, selected_rmw
from r2bspec.plan import this_machine as machine
from r2bspec.plan.plan import ProcessPlan
from r2bspec.plan.process_plans import find_places, graph_processes
from r2bspec.plan.topic_plans import direct_bag_topic


@rule("R2B617")
def environment_variable_unset(context: Context) -> Findings:
    """Listed environment variables that are not set."""
    for index, name in enumerate(context.spec.environment):
        if os.environ.get(name) is None:
            yield Finding(
                message=f"environment variable {name} is not set",
                path=("environment", index),
                help=f"set it, for example: export {name}=...",
                machine_dependent=True,
            )


@rule("R2B638")
def cpus_not_available(context: Context) -> Findings:
    """CPUs that this machine does not have."""
    available = os.cpu_count() or 1
    for path, cpus in _pinned_cpus(context):
        for index, cpu in enumerate(cpus):
            if cpu >= available:
                yield Finding(
                    message=f"this machine has no CPU {cpu}",
                    path=(*path, index),
                    help=f"its CPUs are numbered from 0 to {available - 1}",
                    machine_dependent=True,
                )


def _pinned_cpus(context: Context) -> Iterator[tuple[Path, tuple[int, ...]]]:
    for name, container in context.spec.containers.items():
        yield from _cpus_of(("containers", name), container)
    for _, node in context.nodes:
        yield from _cpus_of(node.path, node.node)


def _cpus_of(path: Path, process: ProcessSettings) -> Iterator[tuple[Path, tuple[int, ...]]]:
    yield (*path, "cpus"), process.cpus
    for index, each in enumerate(process.scheduling.threads if process.scheduling else ()):
        yield (*path, "scheduling", "threads", index, "cpus"), each.cpus


_OTHER_NAMES: Final = {"arm64": "aarch64", "amd64": "x86_64", "x64": "x86_64", "x86-64": "x86_64"}


@rule("R2B669")
def required_machine_unknown(context: Context) -> Findings:
    """Requirements of a machine that no machine can meet."""
    requires = context.spec.requires
    if requires is None:
        return
    arch = _OTHER_NAMES.get(requires.arch.lower(), requires.arch)
    for key, meant, known, lack in (
        ("arch", arch, machine.ARCHITECTURES, "no machine has the architecture"),
        ("ros_distro", requires.ros_distro, machine.ROS_DISTROS, "there is no ROS distribution"),
    ):
        written = getattr(requires, key)
        if written and written not in known:
            yield Finding(
                message=f"{lack} {quote(written)}",
                path=("requires", key),
                help=unknown_name_help(meant, known, "known"),
            )


@rule("R2B675")
def pinned_cpu_beyond_required(context: Context) -> Findings:
    """CPUs that a machine with the required number of cores may not have."""
    requires = context.spec.requires
    if requires is None or not requires.cores:
        return
    for path, cpus in _pinned_cpus(context):
        if cpus and max(cpus) >= requires.cores:
            yield Finding(
                message=f"CPU {max(cpus)} is pinned, but a machine with "
                f"{requires.cores} cores is accepted",
                path=path,
                help=f"set 'requires.cores' to {max(cpus) + 1}: CPUs are numbered from 0",
            )


@rule("R2B676")
def machine_not_as_required(context: Context) -> Findings:
    """Requirements of a machine that this one does not meet."""
    if lacks := machine.unmet(_meetable(context.spec.requires), machine.this_machine()):
        yield Finding(
            message=f"this machine is not what the spec requires: {'; '.join(lacks)}",
            path=("requires",),
            help="run it on a host that fits, for example with 'run --on'; R2BSPEC_LABELS has the "
            "labels of this machine",
            machine_dependent=True,
        )


def _meetable(requires: Requires | None) -> Requires | None:
    """Without what no machine is: that is a finding of its own."""
    if requires is None:
        return None
    return msgspec.structs.replace(
        requires,
        arch=requires.arch if requires.arch in machine.ARCHITECTURES else "",
        ros_distro=requires.ros_distro if requires.ros_distro in machine.ROS_DISTROS else "",
    )


_CAPACITY_BYTES_PER_S = {"udp": 250e6, "shared_memory": 3e9}
"""Bytes per second between two processes on one host. Estimates: a 2-core x86-64 machine carried
2.8 MB messages in 12 ms over UDP on the loopback, and a copy in and out of shared memory in 0.7 ms
to 1 ms."""


@rule("R2B627")
def rate_above_transport_capacity(context: Context) -> Findings:
    """Rates that exceed the capacity of the transport."""
    spec = context.spec
    capacity = _CAPACITY_BYTES_PER_S.get(spec.transport.kind)
    if capacity is None or context.spec.has_own_rate:
        return
    size, name = _largest_message(context)
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


def _largest_message(context: Context) -> tuple[int, str]:
    """The bytes of the largest loaded message, and its topic in the bag; 0 if that is unknown."""
    sizes = [(0, "")]
    for name in context.spec.data_loader.topics:
        info = context.bag.find(name) if context.bag is not None else None
        if info is not None and info.max_message_bytes:
            sizes.append((info.max_message_bytes, name))
    return max(sizes)


_LARGE_FOR_PYTHON_BYTES = 4 << 20
"""Page faults were measured with messages of 6.9 MB, and did not matter with 2.8 MB."""
_KEEPS_BUFFERS = "MALLOC_TRIM_THRESHOLD_"


@rule("R2B418")
def images_in_python_process(context: Context) -> Findings:
    """Player or monitors in a process of Python nodes that gets large messages."""
    spec = context.spec
    if spec.harness.placement != "graph":
        return
    processes = tuple(graph_processes(spec, context.wiring))
    chosen = {place.process for place in find_places(spec, context.wiring, processes)}
    for process in processes:
        if process.name in chosen and pays_for_images(context, process):
            yield Finding(
                message=f"{quote(process.name)} is a process of Python nodes: with player or "
                "monitors in it, large messages may take longer than between processes",
                path=("harness",),
                key=True,
                help="write 'harness: {placement: separate}', or compare both: 'r2bspec run "
                "--scan harness.placement=separate,graph'. The p50 of a relay of 1920x1200 at "
                "15 Hz was 15.6 ms with graph and 10.2 ms with separate, because of page faults "
                "(docs/performance.md, with what helps)",
            )
            return


def pays_for_images(context: Context, process: ProcessPlan) -> bool:
    """Whether the page faults of large messages may cost more than the way to another process."""
    is_python = process.role == "host" and _KEEPS_BUFFERS not in process.env
    return is_python and _largest_message(context)[0] >= _LARGE_FOR_PYTHON_BYTES


def _is_played_unchanged(context: Context, bag_topic: str) -> bool:
    """Whether messages are played in their recorded size."""
    return any(
        direct_bag_topic(context.wiring.topic(played.source), context.spec, context.wiring)
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
    available_bytes = machine.shared_memory_bytes()
    if available_bytes is None:
        return
    processes = len(context.subjects.processes)
    required_bytes = segment.bytes * processes
    if required_bytes > available_bytes:
        yield Finding(
            message=f"{processes} processes with a segment of {segment} each need "
            f"{Size(required_bytes)}, but {machine.SHARED_MEMORY} has "
            f"{Size(available_bytes // 2**20 * 2**20)}",
            path=("transport", "segment"),
            help=f"reduce 'segment', or enlarge {machine.SHARED_MEMORY} (docker run --shm-size)",
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
