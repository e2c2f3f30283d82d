"""The metrics: each is declared by a function, whose docstring ends with the formula.

The argument of a function has the samples of one segment that its scope needs:

    monitor                 `MonitorSamples`
    playback                `PlaybackSamples`; not in a live run
    process, graph, machine `ResourceUse`
    device                  `DeviceUse`
    work                    the processor time of each step, in seconds
    anatomy                 what was observed of the node, topic or monitor, in the order of events
    search, probe           nothing: what was recorded decides

They return a value, the value of each part by its name, or the values of single messages, of which
parts are taken. None is unknown.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from r2bspec.judge.measure.distribution import (
    MAIN_PERCENTILES,
    PARTS,
    SHORT_PERCENTILES,
    TAIL_PERCENTILE,
)
from r2bspec.judge.measure.metric import DECLARED as DECLARED
from r2bspec.judge.measure.metric import Scope, metric

if TYPE_CHECKING:
    from r2bspec.judge.measure.host_usage import DeviceUse, ResourceUse
    from r2bspec.judge.measure.sample_table import MonitorSamples
    from r2bspec.judge.measure.samples import PlaybackSamples
    from r2bspec.judge.measure.times import Seconds

_MAIN: Final = (*MAIN_PERCENTILES, "max")
_ONE: Final = ("",)
"""The columns of a metric that is one value."""
_WORK_PARTS: Final = ("mean", "p50", "p90")
_OBSERVED_PARTS: Final = ("mean", *SHORT_PERCENTILES, "max")

# Traits that several metrics have in common.
_OF_OUTPUTS: Final[dict[str, Any]] = {
    "parts": PARTS,
    "noun": "outputs",
    "lost_is_slowest": True,
    "of_pairs": True,
    "at_any": True,
    "by_turns": True,
}
_OF_INTERVALS: Final[dict[str, Any]] = {
    "parts": PARTS,
    "at_own_pace": True,
    "live": True,
    "level": "the interval between outputs",
}
_COUNTED: Final[dict[str, Any]] = {"at_any": True, "required": False}
_FAULT: Final[dict[str, Any]] = {
    "counts_faults": True,
    "needs_stamp_matching": True,
    "section": "messages",
}
_OF_DEVICES: Final[dict[str, Any]] = {
    "parts": ("mean", "max"),
    "live": True,
    "compared": ("mean",),
}
_USE: Final[dict[str, Any]] = {**_OF_DEVICES, "by_turns": True}
_OF_WORK: Final[dict[str, Any]] = {"parts": _WORK_PARTS, "by_turns": True, "compared": ("p50",)}
_OF_MESSAGES: Final[dict[str, Any]] = {"parts": _OBSERVED_PARTS, "noun": "messages", "live": True}


@metric(
    "throughput",
    Scope.MONITOR,
    "rate",
    "output rate: outputs / window of time",
    parts=("mean",),
    whats={"mean": "output rate: outputs / window of time"},
    at_own_pace=True,
    live=True,
    by_turns=True,
    level="the interval between outputs",
    more_is_better=True,
    title="throughput",
    columns=("mean",),
    section="messages",
    compared=("mean",),
    range_of=("mean",),
)
def throughput(seen: MonitorSamples) -> dict[str, float]:
    """The outputs of a monitor per window of time, each expected output counted once. The window w
    is the time in which the expected outputs are due: their number times the period p, or the
    played time where outputs have none. It begins with the publication of the first step plus the
    shortest latency. A graph that answers all steps within w has the offered rate; a slower graph
    extends the time.

    n / w if t_n ≤ w, or else the maximum over k of k / max(w, t_k + p); n outputs, output k of them
    at t_k
    """
    return {"mean": seen.throughput_hz}


@metric(
    "latency",
    Scope.MONITOR,
    "time",
    "time from publication of the input to reception of the output",
    of_stamps=True,
    live=True,
    level="the latency",
    columns=_MAIN,
    column_of=("answers", "any", "live"),
    section="latency",
    compared=("mean", *MAIN_PERCENTILES),
    range_of=("mean", *_MAIN),
    **_OF_OUTPUTS,
)
def latency(seen: MonitorSamples) -> Seconds:
    """The time from the publication of a step, when the publishing of its first input begins, to
    the arrival of its output in the middleware. If several steps lead to an output, the last step
    counts. In a live graph, the time from the header stamp. A requirement on a percentile or the
    maximum counts a missed output as the slowest.

    received − published, for each expected output
    """
    return seen.latency


@metric(
    "latency_from_due",
    Scope.MONITOR,
    "time",
    "time from the due time of the input to reception of the output",
    level="the latency from the due time",
    title="from due,",
    section="latency",
    section_parts=(TAIL_PERCENTILE,),
    **_OF_OUTPUTS,
)
def latency_from_due(seen: MonitorSamples) -> Seconds:
    """As latency, but from the time at which the publication was due, with the delay of the player.

    received − due, for each expected output
    """
    return seen.latency_from_due


@metric(
    "age",
    Scope.MONITOR,
    "time",
    "time from publication of the newest input in an output to its reception",
    parts=PARTS,
    noun="outputs",
    of_pairs=True,
    of_stamps=True,
    at_own_pace=True,
    live=True,
    level="the age",
    title="age",
    columns=_MAIN,
    column_of=("own pace",),
    reported_of=("own pace", "live"),
    range_of=_MAIN,
)
def age(seen: MonitorSamples) -> Seconds:
    """The time from the publication of the newest input in an output, by its stamp, to the arrival
    of the output. Every output counts. For outputs that answer no input ('match: own_pace'). In a
    live graph, the time from the header stamp.

    received − published, for each output with the stamp of a step
    """
    return seen.age


@metric(
    "interval",
    Scope.MONITOR,
    "time",
    "time between consecutive outputs",
    noun="intervals",
    fewer=1,
    title="interval",
    **_OF_INTERVALS,
)
def interval(seen: MonitorSamples) -> Seconds:
    """The time between two consecutive outputs, in the order of arrival, without duplicates.

    t[i+1] − t[i]
    """
    return seen.interval


@metric(
    "jitter",
    Scope.MONITOR,
    "time",
    "absolute difference of consecutive intervals",
    noun="changes of the interval",
    fewer=2,
    zero_is_ordinary=True,
    title="jitter",
    section="latency",
    section_parts=(TAIL_PERCENTILE,),
    range_of=(TAIL_PERCENTILE,),
    **_OF_INTERVALS,
)
def jitter(seen: MonitorSamples) -> Seconds:
    """How much consecutive intervals differ.

    |(t[i+2] − t[i+1]) − (t[i+1] − t[i])|
    """
    return seen.jitter


@metric("sent", Scope.PLAYBACK, "count", "steps played")
def steps_played(played: PlaybackSamples) -> int:
    """Steps that the player has published.

    number of steps
    """
    return played.sent


@metric(
    "sent",
    Scope.MONITOR,
    "count",
    "steps that count for the monitor",
    columns=_ONE,
    column_of=("answers", "any"),
    section="messages",
    **_COUNTED,
)
def sent(seen: MonitorSamples) -> int:
    """Steps that the player has published and that count for the monitor.

    number of steps with messages of all its inputs
    """
    return seen.sent


@metric(
    "answered",
    Scope.MONITOR,
    "count",
    "expected outputs received",
    required=False,
    section="messages",
)
def answered(seen: MonitorSamples) -> int:
    """Expected outputs that were received.

    answered = expected − missed
    """
    return seen.answered


@metric(
    "received",
    Scope.MONITOR,
    "count",
    "messages received, matched or not",
    at_own_pace=True,
    live=True,
    more_is_better=True,
    columns=_ONE,
    column_of=("any", "own pace", "live"),
)
def received(seen: MonitorSamples) -> int:
    """Messages that the monitor received, whether they match a step or not.

    received = answered + duplicates + unmatched
    """
    return seen.received


@metric(
    "missed",
    Scope.MONITOR,
    "count",
    "expected outputs not received",
    counts_losses=True,
    counts_faults=True,
    columns=_ONE,
    column_of=("answers",),
    section="messages",
)
def missed(seen: MonitorSamples) -> int:
    """Expected outputs that did not arrive before the drain time was over.

    missed = expected − answered
    """
    return seen.missed


@metric(
    "drop_rate",
    Scope.MONITOR,
    "share",
    "missed / expected outputs",
    statistic="share",
    counts_losses=True,
    title="drop rate",
    section="messages",
    compared=_ONE,
    range_of=_ONE,
)
def drop_rate(seen: MonitorSamples) -> float | None:
    """The share of the expected outputs that did not arrive.

    missed / expected
    """
    return seen.missed / seen.expected if seen.expected else None


@metric(
    "late",
    Scope.MONITOR,
    "count",
    "outputs after the end of the segment",
    section="messages",
    **_COUNTED,
)
def late(seen: MonitorSamples) -> int:
    """Outputs that arrived after the period of the last step had ended.

    number of outputs with t > end of the segment
    """
    return seen.late


@metric(
    "duplicates",
    Scope.MONITOR,
    "count",
    "repeated outputs of a step",
    **_FAULT,
)
def duplicates(seen: MonitorSamples) -> int:
    """Outputs of a step that already has an output.

    received − answered − unmatched
    """
    return seen.duplicates


@metric(
    "reordered",
    Scope.MONITOR,
    "count",
    "outputs after that of a later step",
    **_FAULT,
)
def reordered(seen: MonitorSamples) -> int:
    """First outputs of a step that arrived after the output of a later step (RFC 4737).

    number of outputs whose step is before the latest step seen
    """
    return seen.reordered


@metric(
    "unmatched",
    Scope.MONITOR,
    "count",
    "messages that match no step",
    at_any=True,
    counts_faults=True,
    section="messages",
)
def unmatched(seen: MonitorSamples) -> int:
    """Messages that match no step: by their stamp, or more than expected by order.

    received − answered − duplicates
    """
    return seen.unmatched


@metric(
    "overdue",
    Scope.MONITOR,
    "count",
    "unmatched outputs of an earlier segment",
    section="messages",
    **_COUNTED,
)
def overdue(seen: MonitorSamples) -> int:
    """Of the unmatched, outputs of steps of an earlier segment, which had ended.

    number of unmatched messages with the stamp of an earlier step
    """
    return seen.overdue


@metric(
    "early",
    Scope.MONITOR,
    "count",
    "outputs before their step was published",
    **_COUNTED,
)
def early(seen: MonitorSamples) -> int:
    """Outputs that arrived before their step was published: matching by order has gone wrong.

    number of outputs with received < published
    """
    return seen.early


@metric("surplus", Scope.MONITOR, "count", "more outputs than expected, by order", required=False)
def surplus(seen: MonitorSamples) -> int:
    """Matched by order, outputs beyond the expected ones; of the unmatched.

    messages since the first step − expected
    """
    return seen.surplus


@metric(
    "untimed",
    Scope.MONITOR,
    "count",
    "messages without a time of reception",
    at_own_pace=True,
    live=True,
    required=False,
)
def untimed(seen: MonitorSamples) -> int:
    """Messages of which the middleware gave no time of reception: that of taking is used.

    number of messages with received = taken
    """
    return seen.untimed


@metric(
    "playback.rate",
    Scope.PLAYBACK,
    "rate",
    "published rate: (n - 1) / (last - first)",
    statistic="mean",
    more_is_better=True,
)
def playback_rate(played: PlaybackSamples) -> float:
    """The rate at which the player published the steps.

    (n − 1) / (t_last − t_first)
    """
    return played.rate_hz


@metric(
    "playback.lateness",
    Scope.PLAYBACK,
    "time",
    "time from when a publication was due to when it began",
    parts=(*SHORT_PERCENTILES, "max"),
    noun="publications",
)
def lateness(played: PlaybackSamples) -> Seconds:
    """How late the player began to publish a step.

    published − due, for each step
    """
    return played.lateness


_BUSIEST: Final = "the same in the busiest sample"


def _cpu(used: ResourceUse) -> dict[str, float | None]:
    return {"mean": used.cpu_mean, "max": used.cpu_max}


def _memory(used: ResourceUse) -> dict[str, float | None]:
    return {"max": used.memory_max_bytes}


@metric(
    "cpu.<process>",
    Scope.PROCESS,
    "share",
    "processor time",
    title="CPU",
    columns=("mean", "max"),
    whats={"mean": "processor time; one core is 100 %", "max": _BUSIEST},
    **_USE,
)
def cpu(used: ResourceUse) -> dict[str, float | None]:
    """The processor time of a process, with its threads and descendants; 100 % is one core. Sampled
    five times a second.

    mean: (C(end) − C(begin)) / (end − begin), C the processor time used; max: the same between two
    samples at least 100 ms apart
    """
    return _cpu(used)


@metric(
    "memory.<process>",
    Scope.PROCESS,
    "size",
    "resident set",
    title="memory",
    columns=("max",),
    parts=("max",),
    whats={"max": "largest resident set"},
    live=True,
)
def memory(used: ResourceUse) -> dict[str, float | None]:
    """The largest resident set of a process and its descendants at a sample. Shared pages count in
    every process that maps them.

    max over the samples
    """
    return _memory(used)


@metric(
    "cpu.graph",
    Scope.GRAPH,
    "share",
    "processor time",
    whats={
        "mean": "the same of all processes of the graph",
        "max": "the same in their busiest sample",
    },
    **_USE,
)
def cpu_of_graph(used: ResourceUse) -> dict[str, float | None]:
    """The processor time of all processes of the graph, without those of player and monitors,
    unless these share a process with nodes.

    as cpu.<process>, C the sum over the processes
    """
    return _cpu(used)


@metric(
    "memory.graph",
    Scope.GRAPH,
    "size",
    "resident sets",
    parts=("max",),
    whats={"max": "largest sum of their resident sets"},
    live=True,
)
def memory_of_graph(used: ResourceUse) -> dict[str, float | None]:
    """The largest sum of the resident sets of these processes at a sample.

    max over the samples of the sum
    """
    return _memory(used)


@metric(
    "work.<process>",
    Scope.WORK,
    "time",
    "processor time per step",
    title="work",
    columns=("p50", "p90"),
    **_OF_WORK,
)
def work(used: Seconds) -> Seconds:
    """The processor time that a process and its descendants use from when a step is due until the
    next step is due. It excludes waiting, so that other programs change it by little, and includes
    work without messages. The last step of an iteration has no value, nor has a process of the
    graph with the player in it.

    C(due of the next step) − C(due), for each step, C the processor time used
    """
    return used


@metric(
    "work.graph",
    Scope.WORK,
    "time",
    "processor time per step",
    **_OF_WORK,
)
def work_of_graph(used: Seconds) -> Seconds:
    """The same of all processes of the graph together.

    as work.<process>, C the sum over the processes
    """
    return used


@metric(
    "cpu.system",
    Scope.MACHINE,
    "share",
    "CPU of the machine",
    parts=("mean", "max"),
    whats={"mean": "CPU of the machine; one core is 100 %", "max": _BUSIEST},
    live=True,
    by_turns=True,
)
def cpu_of_machine(used: ResourceUse) -> dict[str, float | None]:
    """The processor time of the whole machine, other programs included.

    as cpu.<process>
    """
    return _cpu(used)


@metric(
    "memory.system",
    Scope.MACHINE,
    "size",
    "memory in use",
    parts=("max",),
    whats={"max": "largest memory in use on the machine"},
    live=True,
)
def memory_of_machine(used: ResourceUse) -> dict[str, float | None]:
    """The largest memory in use on the machine, caches left out.

    max over the samples
    """
    return _memory(used)


def _counter(used: DeviceUse, name: str) -> dict[str, float | None]:
    return {"mean": used.mean.get(name), "max": used.most.get(name)}


@metric("gpu.utilization", Scope.DEVICE, "share", "time in which kernels ran", **_OF_DEVICES)
def gpu_utilization(used: DeviceUse) -> dict[str, float | None]:
    """The share of the time in which a kernel ran on a GPU, by NVML, five times a second; 100 % is
    one GPU.

    mean: (B(end) − B(begin)) / (end − begin), B the sum of utilisation · time over samples and
    GPUs; max: the same between two samples at least 100 ms apart
    """
    return _counter(used, "busy_s")


@metric("gpu.utilization.<process>", Scope.DEVICE, "share", "the same of a process", **_OF_DEVICES)
def gpu_utilization_of_process(used: DeviceUse) -> dict[str, float | None]:
    """The same of a process and its descendants, where NVML tells it.

    as gpu.utilization
    """
    return _counter(used, "busy_s")


@metric("gpu.encoder", Scope.DEVICE, "share", "time in which video was encoded", **_OF_DEVICES)
def gpu_encoder(used: DeviceUse) -> dict[str, float | None]:
    """The share of the time in which the video encoders of the GPUs were busy.

    as gpu.utilization
    """
    return _counter(used, "encoder_s")


@metric("gpu.decoder", Scope.DEVICE, "share", "time in which video was decoded", **_OF_DEVICES)
def gpu_decoder(used: DeviceUse) -> dict[str, float | None]:
    """The share of the time in which the video decoders of the GPUs were busy.

    as gpu.utilization
    """
    return _counter(used, "decoder_s")


@metric("gpu.memory", Scope.DEVICE, "size", "GPU memory in use", parts=("max",), live=True)
def gpu_memory(used: DeviceUse) -> dict[str, float | None]:
    """The largest memory in use on all GPUs, that of other programs included.

    max over the samples
    """
    return {"max": used.gpu_bytes}


@metric(
    "gpu.memory.<process>", Scope.DEVICE, "size", "GPU memory in use", parts=("max",), live=True
)
def gpu_memory_of_process(used: DeviceUse) -> dict[str, float | None]:
    """The same of a process and its descendants, where NVML tells it.

    max over the samples
    """
    return {"max": used.gpu_bytes}


@metric("gpu.power", Scope.DEVICE, "power", "power of the GPUs", **_OF_DEVICES)
def gpu_power(used: DeviceUse) -> dict[str, float | None]:
    """The power of all GPUs together.

    (E(end) − E(begin)) / (end − begin), E the energy used
    """
    return _counter(used, "gpu_j")


@metric("power.package", Scope.DEVICE, "power", "power of the processors", **_OF_DEVICES)
def package_power(used: DeviceUse) -> dict[str, float | None]:
    """The power of all processor packages of the machine, by RAPL, whose counters only root can
    read on many machines.

    as gpu.power
    """
    return _counter(used, "package_j")


@metric("energy.gpu", Scope.DEVICE, "energy", "GPU energy per step", statistic="mean")
def gpu_energy(used: DeviceUse) -> float | None:
    """The energy of the GPUs for each step, with what they use without work.

    (E(end) − E(begin)) / steps
    """
    return used.per_step.get("gpu_j")


@metric("energy.package", Scope.DEVICE, "energy", "processor energy per step", statistic="mean")
def package_energy(used: DeviceUse) -> float | None:
    """The energy of the processor packages for each step, likewise.

    as energy.gpu
    """
    return used.per_step.get("package_j")


@metric(
    "<node>.wait",
    Scope.ANATOMY,
    "time",
    "time from when the middleware has received a message to when it is taken",
    of_one_node=True,
    compared=SHORT_PERCENTILES,
    **_OF_MESSAGES,
)
def wait(times: Seconds) -> Seconds:
    """How long a message waits until the node takes it, because its executor is busy or its thread
    does not run.

    beginning of the take − stamp of the reception
    """
    return times


@metric(
    "<node>.take",
    Scope.ANATOMY,
    "time",
    "time to take a message from the middleware",
    of_one_node=True,
    **_OF_MESSAGES,
)
def take(times: Seconds) -> Seconds:
    """How long a node takes to get a message from the middleware, with its deserialisation; for
    rclpy without the conversion from C.

    end of the take − its beginning
    """
    return times


@metric(
    "<node>.callback",
    Scope.ANATOMY,
    "time",
    "time from the beginning of a callback to its end",
    parts=_OBSERVED_PARTS,
    noun="callbacks",
    of_one_node=True,
    live=True,
    compared=SHORT_PERCENTILES,
)
def callback(times: Seconds) -> Seconds:
    """How long the callbacks of a node last that a message or a timer has caused, with their
    publications. A callback that hangs lasts to the last event.

    end of the callback − its beginning
    """
    return times


@metric(
    "<topic>.transport",
    Scope.ANATOMY,
    "time",
    "time from the stamp of the publication to that of the reception",
    compared=SHORT_PERCENTILES,
    **_OF_MESSAGES,
)
def transport(times: Seconds) -> Seconds:
    """How long messages travel from their publisher to a subscription, with serialisation and the
    threads of the middleware.

    stamp of the reception − stamp of the publication
    """
    return times


@metric(
    "<monitor>.path",
    Scope.ANATOMY,
    "time",
    "time from publication of the input to reception, on the path followed",
    parts=_OBSERVED_PARTS,
    noun="outputs",
    lost_is_slowest=True,
    live=True,
    compared=SHORT_PERCENTILES,
)
def path(times: Seconds) -> Seconds:
    """The time from the publication of the input that an output followed to the arrival of the
    output. It needs no stamps, so it is for outputs with new stamps, of several inputs, and of
    timers. An output that never came counts as the slowest.

    arrival − beginning of the publication of the input
    """
    return times


@metric(
    "<node>.load",
    Scope.ANATOMY,
    "share",
    "time in callbacks / window of time",
    statistic="mean",
    of_one_node=True,
    live=True,
)
def load(shares: Seconds) -> Seconds:
    """The share of the window of time in which a callback of the node ran, all threads together.

    time in callbacks / window
    """
    return shares


@metric(
    "<node>.overtaken",
    Scope.ANATOMY,
    "share",
    "messages that it never took / messages sent to it",
    statistic="mean",
    live=True,
)
def overtaken(shares: Seconds) -> Seconds:
    """The share of the messages sent to a node that it never took: newer ones took their places in
    its queue, the middleware lost them, or they are in the queue at the end.

    never taken / (taken + never taken)
    """
    return shares


@metric(
    "path.<node>.share",
    Scope.ANATOMY,
    "share",
    "mean share of the latency that is spent in the node",
    statistic="mean",
    live=True,
)
def share_of_path(shares: Seconds) -> Seconds:
    """The share of the latency of an output that is spent in a node: from when the middleware has
    received its input to when the node publishes, on the path that the message has followed, as a
    mean over the messages of every monitor.

    mean of (time in the node / time from the publication to the arrival)
    """
    return shares


@metric(
    "peak.rate",
    Scope.SEARCH,
    "rate",
    "highest sustained rate",
    statistic="search",
    more_is_better=True,
)
def peak_rate(_: None) -> None:
    """The highest rate that the search found to be sustained. It needs benchmark.search.

    the lower end of the final bracket of the search
    """


@metric(
    "sustained",
    Scope.PROBE,
    "none",
    "whether the offered rate is sustained",
    unit="Hz",
    statistic="sequential",
    more_is_better=True,
)
def sustained(_: None) -> None:
    """Whether the graph sustains the rate of the objective: its backlog does not grow. A
    requirement is the word alone, without a bound.

    a sequential test on the backlog of one probe
    """
