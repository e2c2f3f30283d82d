"""`benchmark` and `slos`: what is played, and what must hold."""

from __future__ import annotations

from r2bspec.language.confidence import CONFIDENCE
from r2bspec.language.probe_length import PROBE
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
)

_SEARCH = record(
    "The search for the highest rate that holds: the backlog of unanswered messages does not "
    "grow, and 'holds' is met.",
    {
        "min": quantity(Rate, "The lowest rate that is tried.", examples=["5 Hz"], positive=True),
        "max": quantity(
            Rate, "The highest rate that is tried.", examples=["200 Hz"], positive=True
        ),
        "precision": quantity(
            Share,
            "The relative width at which the search ends.",
            default="2 %",
            examples=["2 %"],
            positive=True,
        ),
        "holds": {
            **array(
                "What else must hold for a rate to count: one requirement or several.",
                requirement("A condition on one probe.", examples=["drop_rate <= 5 %"]),
                examples=["drop_rate <= 5 %", ["drop_rate <= 5 %", "latency.p99 < 100 ms"]],
            ),
            "type": ["array", "string"],
            SINGLE_ITEM: True,
        },
        "probe": quantity(
            Duration,
            "The longest time for which one rate is tried; most answers are clear sooner.",
            default=str(PROBE),
            examples=[str(PROBE)],
            positive=True,
        ),
        "confidence": quantity(
            Share,
            "How sure the search must be that a rate holds, or that it does not.",
            default=str(Share(CONFIDENCE)),
            examples=[str(Share(CONFIDENCE))],
            positive=True,
        ),
    },
    required=["min", "max"],
    examples=[{"min": "5 Hz", "max": "200 Hz"}],
)

_GATE = record(
    "How verdicts are reached, and what they lead to.",
    {
        "confidence": quantity(
            Share,
            "How sure a verdict must be, in each direction, unless an objective says otherwise.",
            default=str(Share(CONFIDENCE)),
            examples=["99 %"],
            positive=True,
        ),
        "inconclusive": choice(
            "What counts where the data decide nothing: report it with an exit status of its own, "
            "pass or fail.",
            ["report", "pass", "fail"],
            "report",
        ),
        "confirm": boolean(
            "Whether a failure must be found again, in fresh processes, before it counts.",
            default=True,
        ),
        "time_budget": quantity(
            Duration,
            "The longest time that measuring may take: more iterations, disturbed ones played "
            "again and a fresh batch that confirms a failure are left out where they would not "
            "fit.",
            examples=["10 min"],
            positive=True,
        ),
    },
    examples=[{"confidence": "99 %", "inconclusive": "fail"}],
    default={},
)

_RATES: Schema = {
    **record(
        "The rates at which the inputs are played: a list, or a range with 'count' rates or a "
        "'step'.",
        {
            "from": loader_key(
                quantity(Rate, "The first rate.", examples=["10 Hz"], positive=True)
            ),
            "to": loader_key(quantity(Rate, "The last rate.", examples=["60 Hz"], positive=True)),
            "count": loader_key(
                integer(
                    "How many rates there are, evenly spaced.",
                    minimum=2,
                    maximum=1000,
                    examples=[6],
                )
            ),
            "step": loader_key(
                quantity(Rate, "The distance of two rates.", examples=["10 Hz"], positive=True)
            ),
        },
        required=["from", "to"],
        examples=[["10 Hz", "30 Hz"], {"from": "10 Hz", "to": "60 Hz", "step": "10 Hz"}],
        default=[],
    ),
    "type": ["array", "object"],
    "items": quantity(Rate, "One rate of play.", examples=["30 Hz"], positive=True),
}

BENCHMARK: Schema = record(
    "What is played: 'iterations' times 'duration' at each of 'rates', and a search if asked for.",
    {
        "duration": quantity(
            Duration,
            "How long one iteration lasts.",
            default="5 s",
            examples=["10 s"],
            positive=True,
        ),
        "iterations": integer(
            "How often each rate is played.", minimum=1, default=5, examples=[5, 10]
        ),
        "max_iterations": integer(
            "How often each rate may be played where 'iterations' decide nothing; 0 for no more.",
            minimum=0,
            default=0,
            examples=[20],
        ),
        "rates": _RATES,
        "search": _SEARCH,
        "warm_up": quantity(
            Duration,
            "How long is played before each iteration without counting.",
            default="1 s",
            examples=["1 s", "0 s"],
        ),
        "start_timeout": quantity(
            Duration,
            "How long the graph may take until its first output.",
            default="30 s",
            examples=["30 s", "2 min"],
            positive=True,
        ),
        "drain_timeout": quantity(
            Duration,
            "How long is waited for outputs after the last input.",
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
        "Requirements that must hold at one rate.",
        {
            "extends": sibling("objective"),
            "at": quantity(
                Rate,
                "The rate at which the requirements must hold; left out for requirements on the "
                "search as a whole, such as peak.rate. peak is the highest rate that the search "
                "finds.",
                examples=["30 Hz", "peak"],
                positive=True,
                words=["peak"],
            ),
            "level": choice(
                "What a failure is: error fails the run, warn and info are shown, off is not "
                "judged.",
                ["error", "warn", "info", "off"],
                "error",
            ),
            "when": when(),
            "confidence": quantity(
                Share,
                "How sure the verdict must be; benchmark.gate says it for all.",
                examples=["99 %"],
                positive=True,
            ),
            "require": array(
                "What must hold: 'metric op bound', such as latency.p99 < 50 ms; or sustained. "
                "'in 99 % of 1 s windows' behind it asks it of parts of the time.",
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
