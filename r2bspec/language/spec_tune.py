"""`tune`: the values that a search may give to keys of the spec, and what it looks for.

What a description says is shown to the authors of specs; see `r2bspec.language.declaration`.
"""

from typing import Annotated, Any

from r2bspec.language.declaration import Record, key
from r2bspec.language.quantities import Duration


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
