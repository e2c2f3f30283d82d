"""What is played, measured, judged and tuned: from `data_loader` to `tune`, and the harness.

What a description says is shown to the authors of specs; see `r2bspec.language.declaration`.
"""

from decimal import Decimal
from typing import Annotated, Any, Final, Literal

import msgspec

from r2bspec.language import names
from r2bspec.language.benchmark_defaults import CONFIDENCE, CONFIRM, MAX_STARTS, PROBE
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.declaration import Record, Written, key
from r2bspec.language.quantities import Duration, Rate, Share, Size
from r2bspec.language.spec_graph import ActionCall, QoS, RequestFields, ServiceCall, Variables
from r2bspec.safe_io.limits import MAX_PLANNED_ITERATIONS, MAX_RANGE_RATES, MAX_SPEC_ENTRIES

_IMAGE_INPUT: Final = {"from": "buffer/image", "format": "sensor_msgs/msg/Image"}


class BagSource(Record, frozen=True, kw_only=True):
    """A recording: the name of a dataset, or the path of a bag relative to this file. A map can
    also pin the content.

    Attributes:
        dataset: The name of a dataset; 'r2bspec data list' lists them.
        sha256: The digest that 'r2bspec data info' prints; other content is refused.
    """

    about = key("r2b_storage", {"path": "./bags/kitchen"})
    word = Annotated[str, key(path=True, not_empty=True)]

    dataset: Annotated[str, names.DATASET, key("r2b_storage", "r2b_lounge")] = ""
    path: Annotated[
        names.FilePath,
        key(
            *("./bags/kitchen", "/data/drive_07.mcap"),
            description="The path of a bag: its folder, or a single .db3 or .mcap file; "
            "relative to this file.",
            path=True,
        ),
    ] = ""
    sha256: Annotated[str, names.SHA256, key("a3f5" * 16)] = ""

    @classmethod
    def from_word(cls, word: str) -> "BagSource":
        """Return a path if the text looks like one, else a dataset."""
        is_path = "/" in word or word.startswith(".")
        return cls(path=word) if is_path else cls(dataset=word)


class Window(Record, frozen=True, kw_only=True):
    """The part of the recording to use, relative to its first message.

    Attributes:
        start: The start of the window.
        end: The end of the window; default: the end of the recording.
    """

    about = key({"start": "0.0 s", "end": "0.5 s"})

    start: Annotated[Duration, key("0.0 s", "1.5 s")] = Duration(0)
    end: Annotated[Duration | None, key("0.5 s", positive=True)] = None


class DataLoader(Record, frozen=True, kw_only=True):
    """The recorded topics to load, and their names in the graph.

    If the document lists several recordings, `bag` is the first of them.

    Attributes:
        bag: The recording: the name of a dataset, or the path of a bag.
        bags: Several recordings, in their order; their topics are merged.
        window: The part of the recording to use, relative to its first message.
        topics: The topics to load: the topic in the bag, and the topic in the graph.
        publish_tf: Whether the recorded /tf is played with the inputs.
        publish_tf_static: Whether the recorded /tf_static is published before playing starts.
        real_time: Whether the preprocessors get the messages at the recorded times.
    """

    about = key({"bag": "r2b_storage", "topics": {"/d455_1_rgb_image": "data_loader/image"}})

    bag: Annotated[BagSource, key(hidden_default=True)] = BagSource()
    bags: Annotated[tuple[BagSource, ...], key(["./bags/part_1", "./bags/part_2"], at_least=1)] = ()
    window: Window = Window()
    topics: Annotated[
        dict[
            names.GraphTopic,
            Annotated[
                names.GraphTopic,
                key("data_loader/image", description="The topic in the graph."),
            ],
        ],
        key(
            {"/d455_1_rgb_image": "data_loader/image"},
            topics=True,
            at_least=1,
            at_most=MAX_SPEC_ENTRIES,
            unless_live=True,
        ),
    ] = {}
    publish_tf: bool = False
    publish_tf_static: bool = False
    real_time: bool = False

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> "DataLoader":
        """Of several recordings, the first one is also *the* bag."""
        if keys.get("bags"):
            keys["bag"] = keys["bags"][0]
        return cls(**keys)

    @property
    def sources(self) -> tuple[BagSource, ...]:
        """Every recording, in the order of the document; none in a live benchmark."""
        return self.bags or ((self.bag,) if self.bag != BagSource() else ())


class Pairing(Record, frozen=True, kw_only=True):
    """Which messages of several inputs are one step.

    Attributes:
        slop: The largest difference between stamps of messages of one step; 0 s for equal stamps.
    """

    about = key({"slop": "10 ms"})

    slop: Annotated[Duration, key("10 ms")] = Duration(0)


class PlaybackInput(Record, frozen=True, kw_only=True):
    """A topic that is played to the graph.

    Attributes:
        source: The loaded or preprocessed topic that provides the messages.
        format: The type of its messages.
        qos: The QoS profile of the player's publisher, or its name.
        timestamp: header writes the time of playing into each header; none leaves the recorded one.
        pairing: The pairing of this input, if it differs from 'playback.pairing'.
        rate: step plays one message in each step; recorded plays all messages between two steps,
            for an input of another rate; once publishes one message, latched, before the first
            step, such as a map: the last before the window, or else the first in it.
        clock_ahead: How far the clock that stamped this input was ahead of the other clocks.
    """

    about = key(_IMAGE_INPUT)

    source: Annotated[names.GraphTopic, key("buffer/image")] = msgspec.field(name="from")
    format: Annotated[names.MessageType, key("sensor_msgs/msg/Image")]
    qos: QoS = QoS()
    timestamp: Literal["header", "none"] = "header"
    pairing: Pairing | None = None
    rate: Literal["step", "recorded", "once"] = "step"
    clock_ahead: Annotated[Duration, key("5 s")] = Duration(0)


_CALL: Final = {
    "service": {
        "name": "planner/get_plan",
        "type": "nav_msgs/srv/GetPlan",
        "request": {"tolerance": 0.5},
    }
}


ACCEPTED: Final = "_accepted"
FEEDBACK: Final = "_feedback"
"""At the end of the names of what is measured of an action, besides its result."""


class Call(Record, frozen=True, kw_only=True):
    """A call of a service or an action in each step, answered or not: exactly one of both.

    Attributes:
        service: The service and its request.
        action: The action and its goal. NAME measures the result, NAME_accepted the acceptance. A
            goal that does not succeed is missed.
        each: Fields that differ from call to call, used in turn.
        source: The loaded topic NAME/_service_event, whose requests are used in turn, or with mode
            timeline at their times. Stated fields replace recorded fields.
        every: Call at every step, or at every n-th step.
        success: A field of the response; if it is false, the call counts as missed.
        feedback: Whether NAME_feedback is measured, up to the first feedback.
    """

    about = key(_CALL)

    service: ServiceCall | None = None
    action: ActionCall | None = None
    each: Annotated[
        tuple[Annotated[RequestFields, key({"tolerance": 0.1}, description="One call.")], ...],
        key([{"tolerance": 0.1}, {"tolerance": 0.5}], at_most=MAX_SPEC_ENTRIES),
    ] = ()
    source: Annotated[names.GraphTopic | None, key("buffer/plan_calls")] = msgspec.field(
        default=None, name="from"
    )
    every: Annotated[int, key(30, minimum=1)] = 1
    success: Annotated[str, key("success")] = ""
    feedback: bool = False

    def answers(self, name: str) -> "dict[str, Monitor]":
        """What is measured of the call with this name: monitors of what a service answers."""
        ratio = Ratio(inputs=self.every)
        if self.service is not None:
            service = self.service
            return {name: Monitor(topic=service.name, format=service.type, ratio=ratio)}
        action = self.action or ActionCall(name="", type="")
        ends = {name: "get_result", f"{name}{ACCEPTED}": "send_goal"}
        if self.feedback:
            ends[f"{name}{FEEDBACK}"] = "feedback"
        return {
            answer: Monitor(topic=f"{action.name}/_action/{end}", format=action.type, ratio=ratio)
            for answer, end in ends.items()
        }


class Timeline(Record, frozen=True, kw_only=True):
    """How recorded times are converted to times of playing.

    Attributes:
        speed: The speed of playing relative to the recording.
        translations: Delays of inputs, added to their times of playing and stamps.
    """

    about = key({"speed": "50 %"})

    speed: Annotated[Share, key("50 %", "200 %", positive=True)] = Share(1.0)
    translations: Annotated[
        dict[
            names.GraphTopic,
            Annotated[Duration, key("20 ms", description="The delay of one input.")],
        ],
        key({"image": "20 ms"}, topics=True),
    ] = {}


ArrivalKind = Literal["fixed", "poisson", "bursts", "jitter", "dropout"]


MAX_DROPOUT: Final = 0.9
"""The largest share of intervals without a step."""


class Arrivals(Record, frozen=True, kw_only=True):
    """When the steps come. The rate is always their mean rate.

    Attributes:
        kind: fixed: at equal intervals; poisson: independently, as requests of many clients;
            bursts: several at once; jitter: later than at equal intervals, by chance; dropout: at
            equal intervals, some without a step, by chance.
        size: With bursts: the number of steps in a burst.
        share: With bursts: the part of the time between bursts in which the steps come; 0 % is at
            once. With jitter: the largest delay, as a share of the interval. With dropout: the
            share of intervals without a step.
        seed: The seed of chance. Iterations have different times, which are the same in every run.
    """

    about = key("poisson", {"kind": "bursts", "size": 5, "share": "20 %"})
    word = Literal["fixed", "poisson"]

    kind: ArrivalKind = "fixed"
    size: Annotated[int, key(5, minimum=2)] = 2
    share: Annotated[Share | None, key("20 %")] = None
    seed: Annotated[int, key(7, minimum=0)] = 1

    @classmethod
    def from_word(cls, word: Any) -> "Arrivals":
        """That kind, with the default seed."""
        return cls(kind=word)

    def __str__(self) -> str:
        words = {"bursts": f"bursts of {self.size}", "poisson": "Poisson arrivals"}
        share = f", {self.share}" if self.share is not None else ""
        return f"{words.get(self.kind, self.kind)}{share}, seed {self.seed}"


class Playback(Record, frozen=True, kw_only=True):
    """How the buffered messages are played to the graph.

    Attributes:
        mode: looping repeats the messages at the offered rate; sweeping plays them forwards and
            backwards; timeline uses the recorded times; live plays nothing.
        buffer: The number of messages of each input; 0 means all of the window.
        inputs: The topics to play. The inputs of a step are played together, with the same stamp
            unless 'pairing' allows differences.
        calls: Services and actions that are called in each step. Their answers are outputs with the
            name of the call.
        unpaired: What to do about messages without a partner in every other input, which are never
            played: refuse warns above 5 % of an input and stops above 50 %; drop accepts any
            number.
        timeline: With mode timeline: how recorded times become times of playing.
        record_timeline: Whether the timeline uses the times at which the preprocessors published.
        tf: Whether stamps in /tf are shifted like other stamps, or kept.
        pairing: Which messages of several inputs are one step.
        arrivals: When the steps come: at equal intervals, or as in service.
        clock: Whether the system time is published on /clock at 100 Hz, for nodes with
            'use_sim_time'.
    """

    about = key({"mode": "looping", "buffer": 30, "inputs": {"image": _IMAGE_INPUT}})

    mode: Literal["timeline", "looping", "sweeping", "live"] = "looping"
    buffer: Annotated[int, key(30, 0, minimum=0)] = 0
    inputs: Annotated[
        dict[names.GraphTopic, PlaybackInput],
        key(
            {"image": _IMAGE_INPUT},
            topics=True,
            at_least=1,
            at_most=MAX_SPEC_ENTRIES,
            unless_live=True,
        ),
    ] = {}
    calls: Annotated[
        dict[names.MonitorName, Call],
        key({"plan": _CALL}, at_least=1, at_most=MAX_SPEC_ENTRIES),
    ] = {}
    unpaired: Literal["refuse", "drop"] = "refuse"
    timeline: Timeline = Timeline()
    record_timeline: bool = False
    tf: Literal["shift", "keep"] = "shift"
    pairing: Pairing = Pairing()
    arrivals: Annotated[Arrivals, key(default="fixed")] = Arrivals()
    clock: Annotated[bool, key(changes="graph")] = False

    @property
    def played(self) -> dict[str, PlaybackInput]:
        """The inputs that are played in steps, or between them."""
        return {name: each for name, each in self.inputs.items() if each.rate != "once"}

    @property
    def latched(self) -> dict[str, PlaybackInput]:
        """The inputs of which one message is published before the first step."""
        return {name: each for name, each in self.inputs.items() if each.rate == "once"}


TransportKind = Literal["inherit", "shared_memory", "udp"]
HarnessPlacement = Literal["separate", "shared", "graph"]


class Transport(Record, frozen=True, kw_only=True):
    """How messages are transported.

    Attributes:
        kind: How messages are transported.
        segment: The shared memory segment of each process; default: for the largest message.
    """

    about = key("shared_memory", {"kind": "shared_memory", "segment": "64 MiB"})
    word = TransportKind

    kind: TransportKind = "shared_memory"
    segment: Annotated[Size | None, key("64 MiB", positive=True, changes="graph")] = None

    @classmethod
    def from_word(cls, word: Any) -> "Transport":
        """That kind, with a segment for the largest message."""
        return cls(kind=word)


class Network(Record, frozen=True, kw_only=True):
    """What a network between the processes of the graph does to every message from one process to
    another, also from the player and to the monitors.

    Attributes:
        delay: The delay of every packet.
        jitter: The largest deviation of the delay, either way.
        loss: The share of packets that are lost; a packet has at most 1500 bytes.
        rate: How much passes in a second.
    """

    about = key({"delay": "5 ms", "loss": "1 %"})

    delay: Annotated[Duration | None, key("5 ms")] = None
    jitter: Annotated[Duration | None, key("1 ms")] = None
    loss: Annotated[Share | None, key("1 %")] = None
    rate: Annotated[Size | None, key("12 MB", positive=True)] = None

    def __str__(self) -> str:
        named = {name: getattr(self, name) for name in self.__struct_fields__}
        return ", ".join(
            f"{name} {value}{'/s' if name == 'rate' else ''}"
            for name, value in named.items()
            if value is not None
        )


class Harness(Record, frozen=True, kw_only=True):
    """Where the player and the monitors run.

    Attributes:
        placement: separate: player and monitors have their own processes; shared: they share a
            process; graph: the player runs in the process that reads the inputs, each monitor in
            the process that publishes its topic.
        process: With placement graph: the node or process of the player, if that is ambiguous;
            NODE/PROGRAM of a launch file.
    """

    about = key("graph", {"placement": "graph", "in": "detector"})
    word = HarnessPlacement

    placement: HarnessPlacement = "separate"
    process: Annotated[names.ProcessName, key("detector", "stack/detector")] = msgspec.field(
        name="in", default=""
    )

    @classmethod
    def from_word(cls, word: Any) -> "Harness":
        """That placement."""
        return cls(placement=word)


class Ratio(Record, frozen=True, kw_only=True):
    """How many outputs answer how many inputs.

    Attributes:
        inputs: The number of inputs.
        outputs: The number of outputs.
    """

    about = key({"inputs": 2})

    inputs: Annotated[int, key(2, minimum=1)] = 1
    outputs: Annotated[int, key(3, minimum=1)] = 1


Match = Literal["stamp", "order", "any", "own_pace"]


class MonitorSettings(Record, frozen=True, kw_only=True):
    """How a topic is monitored: keys of `monitors` that the plan has as they are.

    What is declared here is a key of the language and a field of `r2bspec.plan.plan.MonitorPlan` at
    once.

    Attributes:
        match: How outputs are matched to inputs: by stamp; by order; any: by stamp, with any number
            of outputs of an input; own_pace: not at all, for outputs of a timer.
        qos: The profile of the subscription, or its name; default: the profile of the publisher.
        label: The name in reports.
    """

    match: Match = "stamp"
    qos: QoS | None = None
    label: Annotated[str, key("Tag detections")] = ""

    @property
    def own_pace(self) -> bool:
        """Whether its messages answer no input."""
        return self.match == "own_pace"

    @property
    def counts_answers(self) -> bool:
        """Whether a known number of messages is expected of inputs."""
        return self.match in {"stamp", "order"}


class Monitor(MonitorSettings, frozen=True, kw_only=True):
    """A monitored topic.

    Attributes:
        topic: The topic to monitor.
        format: The type of its messages.
        answers: With mode timeline: the inputs that the outputs answer; only steps with all of them
            count. Default: all inputs with a path to the topic.
        ratio: How many outputs answer how many inputs.
        process: With placement graph: the node or process that gets the monitor, if not the
            publisher's.
    """

    about = key({"topic": "tag_detections", "format": "geometry_msgs/msg/PoseArray"})

    topic: Annotated[names.GraphTopic, key("tag_detections", "/tf")]
    format: Annotated[names.MessageType, key("geometry_msgs/msg/PoseArray")]
    answers: Annotated[
        tuple[Annotated[names.GraphTopic, key("image", description="A playback input.")], ...],
        key(["image"]),
    ] = ()
    ratio: Ratio = Ratio()
    process: Annotated[names.ProcessName, key("detector")] = msgspec.field(name="in", default="")


_Requirement = Annotated[
    Requirement,
    key(
        *("latency.p99 < 50 ms", "drop_rate <= 0.5 %", "sustained"), description="One requirement."
    ),
]


class Search(Record, frozen=True, kw_only=True):
    """Search for the highest sustained rate: the backlog of unanswered messages does not grow, and
    the conditions in 'holds' are met.

    Attributes:
        min: The lowest rate of the search.
        max: The highest rate of the search.
        precision: The relative precision at which the search ends.
        holds: Further conditions for a sustained rate.
        probe: The maximum duration of the probe of one rate.
        confirm: How long the lower end of the result is played to confirm it; 0 s: not at all.
        confidence: The confidence at which a rate is sustained, or not.
    """

    about = key({"min": "5 Hz", "max": "200 Hz"})

    min: Annotated[Rate, key("5 Hz", positive=True)]
    max: Annotated[Rate, key("200 Hz", positive=True)]
    precision: Annotated[Share, key("2 %", positive=True)] = Share(0.02)
    holds: Annotated[
        tuple[Requirement, ...],
        Written(tuple[_Requirement, ...] | _Requirement),
        key("drop_rate <= 5 %", ["drop_rate <= 5 %", "latency.p99 < 100 ms"]),
    ] = ()
    probe: Annotated[Duration, key(str(PROBE), positive=True)] = PROBE
    confirm: Annotated[Duration, key(str(CONFIRM), "0 s")] = CONFIRM
    confidence: Annotated[Share, key(str(Share(CONFIDENCE)), positive=True)] = Share(CONFIDENCE)

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> "Search":
        """One condition is a list of one."""
        if isinstance(keys.get("holds"), Requirement):
            keys["holds"] = (keys["holds"],)
        return cls(**keys)


_COLCON: Final = ["colcon", "build", "--symlink-install"]


class GateBase(Record, frozen=True, kw_only=True):
    """How the base of a comparison with a revision is built and set up.

    Attributes:
        build: The commands that build it, one after the other, in the top of its work tree.
        setup: What its runs are set up with after that: a setup file to source, the folder of an
            installation, or NAME=VALUE.
        timeout: The maximum duration of each command; beyond it, the build fails.
    """

    about = key({"build": [_COLCON], "setup": "install/setup.bash"})

    build: Annotated[
        tuple[
            Annotated[
                tuple[Annotated[str, key("colcon", description="An argument.")], ...],
                key(
                    _COLCON,
                    description="A program with its arguments, one item each, run without a shell.",
                    at_least=1,
                ),
            ],
            ...,
        ],
        key([_COLCON]),
    ] = ()
    setup: Annotated[str, key("install/setup.bash")] = ""
    timeout: Annotated[Duration, key("10 min", default="30 min", positive=True)] = Duration(
        30 * 60 * 10**9
    )


class Gate(Record, frozen=True, kw_only=True):
    """How verdicts are reached, and their consequences.

    Attributes:
        confidence: The confidence of a verdict, unless an objective sets its own.
        inconclusive: The outcome of an inconclusive verdict; report has its own exit status.
        confirm: Whether a failure counts only if new processes confirm it.
        time_budget: The maximum duration of measuring: further starts, reruns and confirmation that
            would exceed it are skipped.
        interference: tolerate ignores other load on the machine; note makes a failure inconclusive
            that the load can explain.
        base: How 'r2bspec gate' builds the base; the base's own version of this key counts. Paths
            are relative to the work tree.
    """

    about = key({"confidence": "99 %", "inconclusive": "fail"})

    confidence: Annotated[Share, key("99 %", positive=True)] = Share(CONFIDENCE)
    inconclusive: Literal["report", "pass", "fail"] = "report"
    confirm: bool = True
    time_budget: Annotated[Duration | None, key("10 min", positive=True)] = None
    interference: Literal["tolerate", "note"] = "note"
    base: GateBase = GateBase()


class RateRange(Record, frozen=True, kw_only=True):
    """Evenly spaced rates in place of a list of them.

    Attributes:
        first: The first rate.
        last: The last rate.
        count: The number of rates, evenly spaced.
        step: The distance between two rates.
    """

    first: Annotated[Rate, key("10 Hz", positive=True)] = msgspec.field(name="from")
    last: Annotated[Rate, key("60 Hz", positive=True)] = msgspec.field(name="to")
    count: Annotated[int | None, key(6, minimum=2, maximum=MAX_RANGE_RATES)] = None
    step: Annotated[Rate | None, key("10 Hz", positive=True)] = None

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> tuple[Rate, ...]:
        """Return the rates, in exact arithmetic; the last is `to` only if the step reaches it.

        Ranges that are refused (`r2bspec.language.key_constraints`) are those without an end.
        """
        first, last = Decimal(repr(keys["first"].hz)), Decimal(repr(keys["last"].hz))
        if "step" in keys:
            step = Decimal(repr(keys["step"].hz))
            count = int((last - first) / step) + 1
        else:
            count = keys.get("count", 2)
            step = (last - first) / (count - 1)
        rates = (first + step * index for index in range(min(count, MAX_RANGE_RATES)))
        return tuple(Rate(float(rate)) for rate in rates)


_Played = Annotated[Rate, key("30 Hz", positive=True, description="A rate of playing.")]


class StartWaits(Record, frozen=True, kw_only=True):
    """How long every start waits before anything is counted.

    All of it is a part of the time of a run, and a smoke run shortens it.

    Attributes:
        warm_up: How long each start plays before anything counts; it lasts until every monitor has
            a message.
    """

    warm_up: Annotated[Duration, key("1 s", "0 s")] = Duration(10**9)


class Pacing(StartWaits, frozen=True, kw_only=True):
    """How long a run waits, at least or at most: keys of `benchmark` that the plan has as they are.

    A key that only the executor reads is one of these, or of `StartWaits`: what is declared here is
    a key of the language and a field of `r2bspec.plan.plan.Plan` at once.

    Attributes:
        start_timeout: The maximum time from the first process of the graph to its first output.
        drain_timeout: How long the graph may be silent after the last input before missing outputs
            count as lost.
    """

    start_timeout: Annotated[Duration, key("30 s", "2 min", positive=True, changes="graph")] = (
        Duration(30 * 10**9)
    )
    drain_timeout: Annotated[Duration, key("5 s", positive=True, changes="graph")] = Duration(
        5 * 10**9
    )


class Benchmark(Pacing, frozen=True, kw_only=True):
    """What is played: 'iterations' iterations of 'duration' at each of 'rates', in 'starts' starts
    of all processes; and a search if there is one.

    Attributes:
        duration: The duration of one iteration.
        iterations: The number of iterations at each rate, over all starts.
        starts: How often all processes are started, at most, each time for a part of the
            iterations: once, or at least 3 times. Default: 5, or as many as have two iterations
            each; 1 with external nodes.
        max_iterations: The maximum number of iterations at each rate, to decide an inconclusive
            verdict.
        anatomy: Trace the processes of the graph, or of the listed nodes, in every iteration, for
            metrics such as NODE.callback.p99. 'run --anatomy' traces one extra iteration.
        rates: The rates at which the inputs are played.
        search: Search for the highest rate at which the backlog of unanswered messages does not
            grow.
        gate: How verdicts are reached, and their consequences.
    """

    about = key({"duration": "10 s", "iterations": 10, "rates": ["10 Hz", "30 Hz"]})

    duration: Annotated[Duration, key("10 s", positive=True)] = Duration(2_500_000_000)
    iterations: Annotated[int, key(10, minimum=1, maximum=MAX_PLANNED_ITERATIONS)] = 10
    starts: Annotated[int | None, key(5, 1, minimum=1, maximum=MAX_STARTS)] = None
    max_iterations: Annotated[int, key(20, minimum=0, maximum=MAX_PLANNED_ITERATIONS)] = 0
    anatomy: Annotated[
        bool | tuple[str, ...],
        Written(
            Annotated[bool, key(True)]
            | tuple[
                Annotated[names.ProcessName, key("detector", description="A node, or a process.")],
                ...,
            ]
        ),
        key(True, ["detector"]),
    ] = False
    rates: Annotated[
        tuple[Rate, ...],
        Written(tuple[_Played, ...] | RateRange),
        key(["10 Hz", "30 Hz"], {"from": "10 Hz", "to": "60 Hz", "step": "10 Hz"}),
    ] = ()
    search: Search | None = None
    gate: Annotated[Gate, key(changes="neither")] = Gate()


class Objective(Record, frozen=True, kw_only=True):
    """Requirements at one rate.

    Attributes:
        at: The rate at which the requirements apply, or peak; omitted for requirements on the
            search.
        level: error fails the run; warn and info only report; off skips the objective.
        when: Apply the objective only if these variables have these values.
        confidence: The confidence of the verdict; default: that of benchmark.gate.
        require: The requirements.
        at_peak: Whether `at` is the highest rate that the search finds.
    """

    about = key({"at": "30 Hz", "require": ["latency.p99 < 50 ms"]})

    at: Annotated[
        Rate | None,
        Written(Rate | Literal["peak"]),
        key("30 Hz", "peak", positive=True),
    ] = None
    level: Literal["error", "warn", "info", "off"] = "error"
    when: Variables = {}
    confidence: Annotated[Share | None, key("99 %", positive=True)] = None
    require: Annotated[
        tuple[_Requirement, ...],
        key(["latency.p99 < 50 ms", "drop_rate <= 0.5 %"], at_least=1),
    ]
    at_peak: Annotated[bool, key(derived=True)] = False

    @classmethod
    def from_keys(cls, keys: dict[str, Any]) -> "Objective":
        """`at: peak` is no rate yet."""
        if keys.get("at") == "peak":
            keys["at"], keys["at_peak"] = None, True
        return cls(**keys)


class Tune(Record, frozen=True, kw_only=True):
    """What 'r2bspec tune' may change, and what it looks for.

    Attributes:
        values: The values to try besides those that the spec has, by the paths of keys below graph,
            containers or transport, written as for --set.
        minimize: The metric to make as small as possible among the combinations of values that meet
            the objectives.
        trials: The maximum number of combinations that are tried.
        budget: The maximum duration of the search and its proof.
        pairs: The maximum number of pairs of runs in which the best combination is compared with
            the spec as it is.
    """

    about = key(
        {"values": {"graph.nodes.detector.parameters.batch": [1, 2]}, "minimize": "latency.p99"}
    )

    values: Annotated[
        dict[
            Annotated[str, key(not_empty=True)],
            Annotated[
                tuple[Annotated[Any, key(2, "64 MiB", description="A value of the key.")], ...],
                key([1, 2, 4], description="The values of the key.", at_least=1),
            ],
        ],
        key({"graph.nodes.detector.parameters.batch": [1, 2, 4]}),
    ] = {}
    minimize: Annotated[str, key("latency.p99", not_empty=True)] = "cpu.graph.mean"
    trials: Annotated[int, key(30, minimum=1, maximum=10_000)] = 30
    budget: Annotated[Duration, key("20 min", positive=True)] = Duration(20 * 60 * 10**9)
    pairs: Annotated[int, key(8, minimum=3, maximum=1000)] = 8
