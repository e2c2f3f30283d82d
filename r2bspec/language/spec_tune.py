"""`tune`: what a search for a better deployment of the graph may change, and what it looks for.

What a description says is shown to the authors of specs; see `r2bspec.language.declaration`.
"""

from typing import Annotated, Any, Literal

from r2bspec.language import names
from r2bspec.language.declaration import Record, key
from r2bspec.language.quantities import Duration

LeverGroup = Literal[
    "placement",
    "containers",
    "executor",
    "threads",
    "cpus",
    "nice",
    "scheduling",
    "qos",
    "transport",
    "intra_process",
    "environment",
]
"""What levers are about, as `tune.levers` names it."""


class TuneLimits(Record, frozen=True, kw_only=True):
    """Limits of what is tried.

    Attributes:
        threads: The most threads of one executor; default: the CPUs that r2bspec may use.
        processes: The most processes of the graph; default: no limit.
    """

    about = key({"threads": 4, "processes": 6})

    threads: Annotated[int | None, key(4, minimum=1)] = None
    processes: Annotated[int | None, key(6, minimum=1)] = None


class Tune(Record, frozen=True, kw_only=True):
    """What 'r2bspec tune' may change of how the graph is deployed, and what it looks for.

    Attributes:
        levers: What is varied. Default: everything that changes nothing for other programs of the
            machine; 'r2bspec plan --tune' lists it.
        keep: Nodes whose deployment stays as it is.
        values: Further levers: the path of a key below graph, containers or transport, and the
            values to try besides the one that it has.
        limits: Limits of what is tried.
        minimize: The metric to make as small as possible among the deployments that meet the
            objectives.
        trials: The most deployments that are tried.
        budget: The maximum duration of the search and its proof.
        pairs: The number of pairs of runs in which the best deployment is compared with today's.
    """

    about = key({"levers": ["placement", "threads"], "keep": ["camera"], "minimize": "latency.p99"})

    levers: Annotated[
        tuple[Annotated[LeverGroup, key(description="A group of levers.")], ...],
        key(["placement", "threads"]),
    ] = ()
    keep: Annotated[
        tuple[Annotated[names.NodeName, key("camera", description="The name of a node.")], ...],
        key(["camera"]),
    ] = ()
    values: Annotated[
        dict[
            Annotated[str, key(not_empty=True)],
            Annotated[
                tuple[Annotated[Any, key(2, "64 MiB", description="One value of the key.")], ...],
                key([1, 2, 4], description="The values of the key.", at_least=1),
            ],
        ],
        key({"graph.nodes.detector.parameters.batch": [1, 2, 4]}),
    ] = {}
    limits: TuneLimits = TuneLimits()
    minimize: Annotated[str, key("latency.p99", not_empty=True)] = "cpu.graph.mean"
    trials: Annotated[int, key(30, minimum=1, maximum=10_000)] = 30
    budget: Annotated[Duration, key("20 min", positive=True)] = Duration(20 * 60 * 10**9)
    pairs: Annotated[int, key(8, minimum=2, maximum=1000)] = 8
