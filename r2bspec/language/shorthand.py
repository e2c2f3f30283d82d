"""Expansion of the shorthands of the language.

The input is a document that is valid by the strict schema, the output has the form of
`r2bspec.language.spec`. Expanded are:

- a bag, one condition, a transport, a harness or a QoS profile written as one word,
- a QoS profile based on a named one,
- several bags, the first of which is also *the* bag,
- declared variables, of which only the value is kept,
- parameters as a file or as a list of files and maps,
- a range of rates,
- ``at: peak``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from decimal import Decimal
from typing import Any

from r2bspec.language.qos_profiles import PROFILES
from r2bspec.language.quantities import Rate

Plain = dict[str, Any]

MAX_RANGE_RATES = 1000
"""The most rates of a range."""

LOADER_KEYS = ("extends", "matrix")
"""Top-level keys of a document that `Spec` does not have."""


def expand_shorthands(document: Plain) -> Plain:
    """The document without shorthands; its values are shared, not changed."""
    done = {key: value for key, value in document.items() if key not in LOADER_KEYS}
    for key, change in _SECTIONS.items():
        if key in done:
            done[key] = change(done[key])
    transport = document.get("transport")
    if isinstance(transport, dict):
        done["transport"] = transport.get("kind", "shared_memory")
        if "segment" in transport:
            done["segment"] = transport["segment"]
    return done


def bag_source(bag: str | Plain) -> Plain:
    """A bag written as a string: a path if it looks like one, else a dataset."""
    if isinstance(bag, dict):
        return bag
    return {"path" if "/" in bag or bag.startswith(".") else "dataset": bag}


def qos(written: str | Plain) -> Plain:
    """A profile with all fields of the named profile, or of the one it is based on."""
    if isinstance(written, str):
        return PROFILES[written]
    if "profile" not in written:
        return written
    own = {key: value for key, value in written.items() if key != "profile"}
    return PROFILES[written["profile"]] | own


def expand_rate_range(between: Mapping[str, Any]) -> list[str]:
    """The rates of a range, in exact arithmetic; the last is `to` only if the step reaches it.

    At most `MAX_RANGE_RATES`, and none for a step of zero: invalid ranges are reported by
    `r2bspec.language.key_constraints.document_keys`.
    """
    first, last = (Decimal(repr(Rate.parse(between[key]).hz)) for key in ("from", "to"))
    if "step" in between:
        step = Decimal(repr(Rate.parse(between["step"]).hz))
        count = int((last - first) / step) + 1 if step > 0 else 0
    else:
        count = between.get("count", 2)
        step = (last - first) / (count - 1)
    return [str(Rate(float(first + step * index))) for index in range(min(count, MAX_RANGE_RATES))]


def variable_value(declared: Any) -> Any:
    """The value of a variable, declared as a map or not; None if it has none."""
    if isinstance(declared, dict):
        return declared.get("value", declared.get("default"))
    return declared


def _map_values(change: Callable[[Any], Any]) -> Callable[[Plain], Plain]:
    return lambda entries: {name: change(each) for name, each in entries.items()}


def _with_changed(entry: Plain, key: str, change: Callable[[Any], Any]) -> Plain:
    return {**entry, key: change(entry[key])} if key in entry else entry


def _data_loader(loader: Plain) -> Plain:
    bags = [bag_source(each) for each in loader.get("bags", ())]
    if bags:
        return {**loader, "bag": bags[0], "bags": bags}
    return _with_changed(loader, "bag", bag_source)


def _harness(written: str | Plain) -> Plain:
    return {"placement": written} if isinstance(written, str) else written


def _node(node: Plain) -> Plain:
    written = node.get("parameters")
    if isinstance(written, str | list):
        parts = written if isinstance(written, list) else [written]
        sources = [{"file": p} if isinstance(p, str) else {"values": p} for p in parts]
        node = {**node, "parameters": {}, "parameter_sources": sources}
        for source in sources:
            node["parameters"] = node["parameters"] | source.get("values", {})
        if not any("file" in source for source in sources):
            del node["parameter_sources"]
    if "qos" in node:
        node = {**node, "qos": {topic: qos(each) for topic, each in node["qos"].items()}}
    return node


def _playback(playback: Plain) -> Plain:
    return _with_changed(
        playback, "inputs", _map_values(lambda each: _with_changed(each, "qos", qos))
    )


def _benchmark(benchmark: Plain) -> Plain:
    if isinstance(benchmark.get("rates"), dict):
        benchmark = {**benchmark, "rates": expand_rate_range(benchmark["rates"])}
    return _with_changed(
        benchmark,
        "search",
        lambda search: _with_changed(search, "holds", lambda h: [h] if isinstance(h, str) else h),
    )


def _objective(objective: Plain) -> Plain:
    if objective.get("at") != "peak":
        return objective
    return {**{key: value for key, value in objective.items() if key != "at"}, "at_peak": True}


_SECTIONS: dict[str, Callable[[Any], Any]] = {
    "variables": _map_values(variable_value),
    "harness": _harness,
    "data_loader": _data_loader,
    "preprocessors": _map_values(_node),
    "playback": _playback,
    "graph": lambda graph: _with_changed(graph, "nodes", _map_values(_node)),
    "monitors": _map_values(lambda each: _with_changed(each, "qos", qos)),
    "benchmark": _benchmark,
    "slos": _map_values(_objective),
}
