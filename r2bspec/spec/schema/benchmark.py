"""`benchmark` and `slos`: what is played, and what must hold."""

from __future__ import annotations

from r2bspec.spec.quantities import Duration, Rate, Share
from r2bspec.spec.schema import names
from r2bspec.spec.schema.build import (
    Schema,
    integer,
    listing,
    named,
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
            **listing(
                "What else must hold for a rate to count: one requirement or several.",
                requirement("A condition on one probe.", examples=["drop_rate <= 5 %"]),
                examples=["drop_rate <= 5 %", ["drop_rate <= 5 %", "latency.p99 < 100 ms"]],
            ),
            "type": ["array", "string"],
        },
        "probe": quantity(
            Duration,
            "The longest time for which one rate is tried.",
            default="3 s",
            examples=["3 s"],
            positive=True,
        ),
    },
    required=["min", "max"],
    examples=[{"min": "5 Hz", "max": "200 Hz"}],
)

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
        "rates": listing(
            "The rates at which the inputs are played.",
            quantity(Rate, "One rate of play.", examples=["30 Hz"], positive=True),
            examples=[["10 Hz", "30 Hz"]],
        ),
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
    },
    examples=[{"duration": "10 s", "iterations": 10, "rates": ["10 Hz", "30 Hz"]}],
    default={},
)

SLOS: Schema = named(
    "The objectives that decide the verdict, by name.",
    names.NAME,
    record(
        "Requirements that must hold at one rate.",
        {
            "at": quantity(
                Rate,
                "The rate at which the requirements must hold; left out for requirements on the "
                "search as a whole, such as peak.rate.",
                examples=["30 Hz"],
                positive=True,
            ),
            "require": listing(
                "What must hold: 'metric op bound', such as latency.p99 < 50 ms; or sustained.",
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
