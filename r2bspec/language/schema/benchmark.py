"""`benchmark` and `slos`: rates, iterations, search and requirements."""

from __future__ import annotations

from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.default_starts import MAX_STARTS
from r2bspec.language.probe_length import CONFIRM, PROBE
from r2bspec.language.quantities import Duration, Rate, Share
from r2bspec.language.schema import name_patterns
from r2bspec.language.schema.reuse import sibling, when
from r2bspec.language.schema.schema_builder import (
    SINGLE_ITEM,
    Schema,
    array,
    boolean,
    choice,
    integer,
    loader_key,
    name_map,
    quantity,
    record,
    requirement,
    text,
)

_SEARCH = record(
    "Search for the highest sustained rate: the backlog of unanswered messages does not grow, and "
    "the conditions in 'holds' are met.",
    {
        "min": quantity(Rate, "The lowest rate of the search.", examples=["5 Hz"], positive=True),
        "max": quantity(
            Rate, "The highest rate of the search.", examples=["200 Hz"], positive=True
        ),
        "precision": quantity(
            Share,
            "The search ends when the peak is known to this relative precision.",
            default="2 %",
            examples=["2 %"],
            positive=True,
        ),
        "holds": {
            **array(
                "Further conditions for a rate to count as sustained: one requirement or several.",
                requirement("A condition on one probe of a rate.", examples=["drop_rate <= 5 %"]),
                examples=["drop_rate <= 5 %", ["drop_rate <= 5 %", "latency.p99 < 100 ms"]],
            ),
            "type": ["array", "string"],
            SINGLE_ITEM: True,
        },
        "probe": quantity(
            Duration,
            "The maximum duration of the probe of one rate; most probes end earlier.",
            default=str(PROBE),
            examples=[str(PROBE)],
            positive=True,
        ),
        "confirm": quantity(
            Duration,
            "How long the lower end of the result is played without a pause before it counts; a "
            "graph that is fast for a short time only does not sustain it. 0 s: not at all.",
            default=str(CONFIRM),
            examples=[str(CONFIRM), "0 s"],
        ),
        "confidence": quantity(
            Share,
            "The confidence at which a rate counts as sustained, or as not sustained.",
            default=str(Share(CONFIDENCE)),
            examples=[str(Share(CONFIDENCE))],
            positive=True,
        ),
    },
    required=["min", "max"],
    examples=[{"min": "5 Hz", "max": "200 Hz"}],
)

_GATE = record(
    "How verdicts are reached, and their consequences.",
    {
        "confidence": quantity(
            Share,
            "The confidence of a verdict, pass or fail, unless an objective sets its own.",
            default=str(Share(CONFIDENCE)),
            examples=["99 %"],
            positive=True,
        ),
        "inconclusive": choice(
            "The effect of an inconclusive verdict: report it with an exit status of its own, "
            "pass, or fail.",
            ["report", "pass", "fail"],
            "report",
        ),
        "confirm": boolean(
            "Whether a failure counts only if a second run in new processes confirms it.",
            default=True,
        ),
        "time_budget": quantity(
            Duration,
            "The maximum duration of measuring. Additional iterations, repetitions of affected "
            "iterations and probes, and the confirmation of a failure are skipped if they would "
            "exceed it.",
            examples=["10 min"],
            positive=True,
        ),
        "interference": choice(
            "The effect of other load on the machine: tolerate judges the run as it was measured; "
            "note makes a failure inconclusive if the load can explain it; strict also makes a "
            "pass inconclusive if it was measured under such load.",
            ["tolerate", "note", "strict"],
            "note",
        ),
        "base": record(
            "How the base of 'run --against REVISION' becomes what runs: its own version of this "
            "key counts. Paths are relative to the top of the work tree.",
            {
                "build": array(
                    "The commands that build it, one after the other, in the top of its work tree.",
                    array(
                        "A program with its arguments, one item each, run without a shell.",
                        text("An argument.", examples=["colcon"]),
                        at_least=1,
                        examples=[["colcon", "build", "--symlink-install"]],
                    ),
                    examples=[[["colcon", "build", "--symlink-install"]]],
                ),
                "setup": text(
                    "What its runs are set up with after that: a setup file to source, the folder "
                    "of an installation, or NAME=VALUE.",
                    examples=["install/setup.bash"],
                ),
                "timeout": quantity(
                    Duration,
                    "The maximum duration of each command; if it is exceeded, the build fails.",
                    default="30 min",
                    examples=["10 min"],
                    positive=True,
                ),
            },
            examples=[
                {
                    "build": [["colcon", "build", "--symlink-install"]],
                    "setup": "install/setup.bash",
                }
            ],
            default={},
        ),
    },
    examples=[{"confidence": "99 %", "inconclusive": "fail"}],
    default={},
)

_RATES: Schema = {
    **record(
        "The rates at which the inputs are played: a list, or a range with a 'step' or with "
        "'count' rates.",
        {
            "from": loader_key(
                quantity(Rate, "The first rate.", examples=["10 Hz"], positive=True)
            ),
            "to": loader_key(quantity(Rate, "The last rate.", examples=["60 Hz"], positive=True)),
            "count": loader_key(
                integer(
                    "The number of rates, evenly spaced.",
                    minimum=2,
                    maximum=1000,
                    examples=[6],
                )
            ),
            "step": loader_key(
                quantity(Rate, "The distance between two rates.", examples=["10 Hz"], positive=True)
            ),
        },
        required=["from", "to"],
        examples=[["10 Hz", "30 Hz"], {"from": "10 Hz", "to": "60 Hz", "step": "10 Hz"}],
        default=[],
    ),
    "type": ["array", "object"],
    "items": quantity(Rate, "A rate of playing.", examples=["30 Hz"], positive=True),
}

BENCHMARK: Schema = record(
    "What is played: 'iterations' iterations of 'duration' at each of 'rates', in 'starts' starts "
    "of all processes; and a search if there is one.",
    {
        "duration": quantity(
            Duration,
            "The duration of one iteration.",
            default="2.5 s",
            examples=["10 s"],
            positive=True,
        ),
        "iterations": integer(
            "The number of iterations at each rate, over all starts.",
            minimum=1,
            default=10,
            examples=[10],
        ),
        "starts": integer(
            "The number of starts: how often all processes are started afresh, each time for a "
            "part of the iterations. A verdict is about the graph, and not about one start of it, "
            "if there are several. Default: 5, but each start has at least two iterations; 1 for "
            "graphs with external nodes, which cannot be restarted.",
            minimum=1,
            maximum=MAX_STARTS,
            examples=[5, 1],
        ),
        "max_iterations": integer(
            "The maximum number of iterations at each rate, played while a verdict is inconclusive "
            "after 'iterations', in further starts if there are several; 0 means no additional "
            "ones.",
            minimum=0,
            default=0,
            examples=[20],
        ),
        "rates": _RATES,
        "search": _SEARCH,
        "warm_up": quantity(
            Duration,
            "How long is played after each start of the processes, before anything is counted; at "
            "least until every monitor has received a message.",
            default="1 s",
            examples=["1 s", "0 s"],
        ),
        "start_timeout": quantity(
            Duration,
            "How long the graph may take from the start of its first process to its first output. "
            "Readiness probes and 'after_ready' steps have timeouts of their own.",
            default="30 s",
            examples=["30 s", "2 min"],
            positive=True,
        ),
        "drain_timeout": quantity(
            Duration,
            "How long the graph may publish nothing, after the last input of an iteration, "
            "until the outputs that are still missing count as lost.",
            default="5 s",
            examples=["5 s"],
            positive=True,
        ),
        "gate": _GATE,
    },
    examples=[{"duration": "10 s", "iterations": 10, "rates": ["10 Hz", "30 Hz"]}],
    default={},
)

SLOS: Schema = name_map(
    "The objectives that decide the verdict, by name.",
    name_patterns.NAME,
    record(
        "Requirements at one rate.",
        {
            "extends": sibling("objective"),
            "at": quantity(
                Rate,
                "The rate at which the requirements apply; omit it for requirements on the whole "
                "search, such as peak.rate. peak is the highest rate that the search finds.",
                examples=["30 Hz", "peak"],
                positive=True,
                words=["peak"],
            ),
            "level": choice(
                "The effect of a failure: error fails the run; warn and info only report it; off "
                "skips the objective.",
                ["error", "warn", "info", "off"],
                "error",
            ),
            "when": when(),
            "confidence": quantity(
                Share,
                "The confidence of the verdict; default: that of benchmark.gate.",
                examples=["99 %"],
                positive=True,
            ),
            "require": array(
                "The requirements: 'metric op bound', such as latency.p99 < 50 ms; or sustained. "
                "With 'in 99 % of 1 s windows' at the end, the requirement applies to windows of "
                "time.",
                requirement(
                    "One requirement.",
                    examples=["latency.p99 < 50 ms", "drop_rate <= 0.5 %", "sustained"],
                ),
                at_least=1,
                examples=[["latency.p99 < 50 ms", "drop_rate <= 0.5 %"]],
            ),
        },
        required=["require"],
        examples=[{"at": "30 Hz", "require": ["latency.p99 < 50 ms"]}],
    ),
    examples=[{"keeps_up": {"at": "30 Hz", "require": ["latency.p99 < 50 ms"]}}],
    snippets=[
        {
            "label": "an objective",
            "body": {"${1:name}": {"at": "${2:30 Hz}", "require": ["${3:latency.p99 < 50 ms}"]}},
        }
    ],
)
