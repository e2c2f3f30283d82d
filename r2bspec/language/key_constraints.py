"""Constraints between keys: which exclude each other, need each other, or have no effect.

JSON Schema's ``oneOf`` could express some of them, but its messages are hard to understand, and
completion with it is poor. They are looked for in the tree, so that a document with other mistakes
has them, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from r2bspec.diagnostics import Diagnostic, Path, Related, Severity, did_you_mean, format_path
from r2bspec.language.located_tree import (
    ListNode,
    MapNode,
    ScalarNode,
    TreeNode,
    child,
    lookup,
    span_at,
)
from r2bspec.language.node_kinds import (
    NODE_KIND_KEYS,
    NODE_KINDS,
    PROCESS_KEYS,
    kinds_help,
    members,
)
from r2bspec.language.quantities import QuantityError, Rate
from r2bspec.language.spec_benchmark import MAX_RANGE_RATES

MAX_REQUIREMENTS = 10_000
"""Requirements of all objectives together: far above every real number."""

_ONE_OF: dict[str, tuple[str, ...]] = {
    "ready": ("file", "service", "log", "topic"),
    "after_ready": ("command", "service"),
}
_TIMELINE_ONLY = ("timeline", "record_timeline", "tf")
_PLAYBACK_SECTIONS = ("data_loader", "preprocessors")


def section_constraint_errors(root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    """Violated constraints; maps at `misspelt` may have a missing key in a misspelt form."""
    for name, keys in _ONE_OF.items():
        for path, entry in _map_entries(root, (name,)):
            yield from _one_of(entry, path, keys, misspelt)
    sections: tuple[Path, ...] = (("preprocessors",), ("graph", "nodes"))
    for section in sections:
        for path, node in _map_entries(root, section):
            launch = child(node, "launch")
            if isinstance(launch, MapNode):
                yield from _launch(launch, (*path, "launch"), misspelt)
    yield from _playback(root)
    yield from _harness(root)
    yield from _transport(root)
    yield from _benchmark(root)
    yield from _conditions(root)
    yield from _requirements(root)


def _map_entries(root: TreeNode, section: Path) -> Iterator[tuple[Path, MapNode]]:
    entries = lookup(root, section)
    if isinstance(entries, MapNode):
        for name, entry in entries.entries.items():
            if isinstance(entry.value, MapNode):
                yield (*section, name), entry.value


def _one_of(
    entry: MapNode, path: Path, keys: Sequence[str], misspelt: set[Path]
) -> Iterator[Diagnostic]:
    given = [key for key in entry.entries if key in keys]
    name = f"'{format_path(path)}'"
    listed = ", ".join(f"'{key}'" for key in keys[:-1]) + f" or '{keys[-1]}'"
    if len(given) > 1:
        yield _both(entry, path, (given[0], given[1]), f"keep only one of {listed}")
    elif not given and path not in misspelt:
        yield Diagnostic(
            "R2B118",
            Severity.ERROR,
            f"{name} needs one of {listed}",
            entry.span,
            path=path,
            help=f"add one of {listed}",
        )


def _launch(launch: MapNode, path: Path, misspelt: set[Path]) -> Iterator[Diagnostic]:
    given = [key for key in launch.entries if key in ("package", "file", "path")]
    help_text = "set 'package' and 'file', or 'path'"
    if "path" in given and len(given) > 1:
        other = next(key for key in given if key != "path")
        yield _both(launch, path, ("path", other), help_text)
    elif len(given) < 2 and "path" not in given and path not in misspelt:
        lacks = {"package": "'file'", "file": "'package'"}.get("".join(given), "a launch file")
        message = f"'{format_path(path)}' needs {lacks}"
        yield Diagnostic("R2B118", Severity.ERROR, message, launch.span, path=path, help=help_text)


def _playback(root: TreeNode) -> Iterator[Diagnostic]:
    playback = child(root, "playback")
    if not isinstance(playback, MapNode):
        return
    mode = _word(playback, "mode") if "mode" in playback.entries else "looping"
    if mode == "live":
        for key in _PLAYBACK_SECTIONS:
            if isinstance(root, MapNode) and key in root.entries:
                message = f"'{key}' has no effect: a live benchmark plays nothing"
                yield _at_key(root, (), key, message, f"remove '{key}', or change playback.mode")
        for key in ("inputs", "buffer", "unpaired", "clock"):
            if key in playback.entries:
                message = f"'playback.{key}' has no effect: a live benchmark plays nothing"
                help_text = f"remove '{key}', or change playback.mode"
                yield _at_key(playback, ("playback",), key, message, help_text)
    if mode and mode != "timeline":
        for key in _TIMELINE_ONLY:
            if key in playback.entries:
                message = f"'playback.{key}' has no effect with mode {mode}"
                help_text = f"remove it, or write 'mode: timeline' instead of '{mode}'"
                yield _at_key(playback, ("playback",), key, message, help_text)
    yield from _recorded_rates(playback, mode)
    yield from _translations(playback)


def _recorded_rates(playback: MapNode, mode: str) -> Iterator[Diagnostic]:
    """Inputs with a rate of their own need steps to be played between."""
    inputs = child(playback, "inputs")
    if not isinstance(inputs, MapNode):
        return
    recorded = {
        name: entry.value
        for name, entry in inputs.entries.items()
        if isinstance(entry.value, MapNode) and _word(entry.value, "rate") == "recorded"
    }
    for name, each in recorded.items():
        path = ("playback", "inputs", name)
        if mode == "timeline":
            message = f"'{format_path((*path, 'rate'))}' has no effect with mode timeline, which "
            message += "plays every input at its recorded times"
            yield _at_key(each, path, "rate", message, "remove it")
        elif len(recorded) == len(inputs.entries):
            message = "no input makes steps: all of them have 'rate: recorded'"
            help_text = "remove it from the input whose rate is offered, or write 'mode: timeline'"
            yield _at_key(each, path, "rate", message, help_text)


def _translations(playback: MapNode) -> Iterator[Diagnostic]:
    inputs = child(playback, "inputs")
    translations = lookup(playback, ("timeline", "translations"))
    if not isinstance(inputs, MapNode) or not isinstance(translations, MapNode):
        return
    for topic, entry in translations.entries.items():
        if topic not in inputs.entries and entry.key_resolved:
            close = did_you_mean(topic, inputs.entries)
            known = "inputs: " + ", ".join(list(inputs.entries)[:10])
            yield _at_key(
                translations,
                ("playback", "timeline", "translations"),
                topic,
                f"unknown playback input '{topic}'",
                f"did you mean '{close}'? {known}" if close else known,
            )


def _harness(root: TreeNode) -> Iterator[Diagnostic]:
    """Processes of the graph are named only where the harness runs in them."""
    harness = child(root, "harness")
    placement = harness.value if isinstance(harness, ScalarNode) else ""
    if isinstance(harness, MapNode):
        placement = _word(harness, "placement")
    if placement == "graph":
        return
    named = [(("harness",), harness), *_map_entries(root, ("monitors",))]
    for path, entry in named:
        if isinstance(entry, MapNode) and "in" in entry.entries:
            message = f"'{format_path((*path, 'in'))}' has no effect: player and monitors do not "
            message += "run in the processes of the graph"
            help_text = "remove it, or write 'harness: {placement: graph}'"
            yield _at_key(entry, path, "in", message, help_text)


def _transport(root: TreeNode) -> Iterator[Diagnostic]:
    transport = child(root, "transport")
    if isinstance(transport, MapNode) and "segment" in transport.entries:
        kind = _word(transport, "kind")
        if kind not in ("", "shared_memory"):
            message = (
                f"'transport.segment' has no effect with {kind}: only shared_memory has segments"
            )
            help_text = "remove it, or write 'kind: shared_memory'"
            yield _at_key(transport, ("transport",), "segment", message, help_text)


def _benchmark(root: TreeNode) -> Iterator[Diagnostic]:
    benchmark = child(root, "benchmark")
    if not isinstance(benchmark, MapNode):
        return
    iterations = _number(benchmark, "iterations", 10)
    max_iterations = _number(benchmark, "max_iterations", 0)
    if iterations is not None and max_iterations and max_iterations < iterations:
        message = (
            f"'benchmark.max_iterations' ({max_iterations}) is less than 'iterations' "
            f"({iterations})"
        )
        yield _at_key(
            benchmark, ("benchmark",), "max_iterations", message, f"use at least {iterations}"
        )
    rates = child(benchmark, "rates")
    if isinstance(rates, MapNode):
        yield from _range(rates)


def _range(rates: MapNode) -> Iterator[Diagnostic]:
    path: Path = ("benchmark", "rates")
    if "count" in rates.entries and "step" in rates.entries:
        yield _both(rates, path, ("count", "step"), "keep one of them")
        return
    if "count" not in rates.entries and "step" not in rates.entries:
        yield Diagnostic(
            "R2B118",
            Severity.ERROR,
            "'benchmark.rates' needs 'step' or 'count'",
            rates.span,
            path=path,
            help="add 'step: 10 Hz', or 'count: 6'",
        )
        return
    first, last, step = (_rate(rates, key) for key in ("from", "to", "step"))
    if first is None or last is None:
        return
    if first >= last:
        message = f"the range of rates is empty: 'to' ({last}) is not above 'from' ({first})"
        yield _at_key(rates, path, "to", message, "swap the two, or write a list of rates")
    elif step is not None and step.hz > 0:
        if step.hz > last.hz - first.hz:
            message = f"a step of {step} is larger than the range from {first} to {last}"
            yield _at_key(rates, path, "step", message, "use a smaller step")
        elif (last.hz - first.hz) / step.hz >= MAX_RANGE_RATES:
            message = f"the range has more than {MAX_RANGE_RATES:,} rates"
            yield _at_key(rates, path, "step", message, "use a larger step")


def _conditions(root: TreeNode) -> Iterator[Diagnostic]:
    """Variables in the `when` of objectives."""
    declared = child(root, "variables")
    known = declared.entries if isinstance(declared, MapNode) else {}
    for path, objective in _map_entries(root, ("slos",)):
        when = child(objective, "when")
        if not isinstance(when, MapNode):
            continue
        for name in when.entries:
            if name not in known:
                close = did_you_mean(name, known)
                listed = "declared variables: " + ", ".join(sorted(known)[:10])
                help_text = listed if known else "declare it under 'variables'"
                yield _at_key(
                    when,
                    (*path, "when"),
                    name,
                    f"unknown variable '{name}'",
                    f"did you mean '{close}'? {listed}" if close else help_text,
                    "R2B120",
                )


def _requirements(root: TreeNode) -> Iterator[Diagnostic]:
    """The requirements of all objectives together have a limit."""
    lists = (child(objective, "require") for _, objective in _map_entries(root, ("slos",)))
    number = sum(len(each.items) for each in lists if isinstance(each, ListNode))
    if number > MAX_REQUIREMENTS:
        yield Diagnostic(
            "R2B129",
            Severity.ERROR,
            f"{number:,} requirements; the limit is {MAX_REQUIREMENTS:,}",
            span_at(root, ("slos",), key=True),
            path=("slos",),
            help="split the spec",
        )


def _word(node: MapNode, key: str) -> str:
    value = child(node, key)
    return value.value if isinstance(value, ScalarNode) and isinstance(value.value, str) else ""


def _number(node: MapNode, key: str, default: int) -> int | None:
    value = child(node, key)
    if value is None:
        return default
    number = value.value if isinstance(value, ScalarNode) else None
    return number if isinstance(number, int) and not isinstance(number, bool) else None


def _rate(node: MapNode, key: str) -> Rate | None:
    try:
        return Rate.parse(_word(node, key))
    except QuantityError:
        return None


def _both(node: MapNode, path: Path, keys: tuple[str, str], help_text: str) -> Diagnostic:
    first, second = sorted(keys, key=list(node.entries).index)
    return Diagnostic(
        "R2B118",
        Severity.ERROR,
        f"'{format_path(path)}' has both '{first}' and '{second}'",
        node.entries[second].key_span,
        path=(*path, second),
        help=help_text,
        related=(Related("the other key", node.entries[first].key_span),),
    )


def _at_key(
    node: MapNode, path: Path, key: str, message: str, help_text: str, code: str = "R2B119"
) -> Diagnostic:
    span = node.entries[key].key_span
    return Diagnostic(code, Severity.ERROR, message, span, path=(*path, key), help=help_text)


_NODE_MAPS: tuple[Path, ...] = (("preprocessors",), ("graph", "nodes"))
_GROUPS = {key: kind.group for kind in NODE_KINDS for key in kind.keys}
_KIND_HELP = f"use one of {kinds_help()}"


def key_constraint_errors(root: TreeNode, found: Sequence[Diagnostic] = ()) -> Iterator[Diagnostic]:
    """Violated constraints: nodes of no kind or of several, bags without a source, and others.

    `found` are the violations of the schema: a map with an unknown key may have the missing key in
    a misspelt form.
    """
    misspelt = {one.path[:-1] for one in found if one.code == "R2B101"}
    for path in _NODE_MAPS:
        nodes = lookup(root, path)
        if isinstance(nodes, MapNode):
            for name, entry in nodes.entries.items():
                if isinstance(entry.value, MapNode):
                    yield from _node(entry.value, (*path, name), root, misspelt)
    yield from _bags(root, misspelt)
    yield from section_constraint_errors(root, misspelt)


def _node(node: MapNode, path: Path, root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    given = [key for key in node.entries if key in NODE_KIND_KEYS and not _is_false(node, key)]
    name = f"'{format_path(path)}'"
    first_of: dict[str, str] = {}
    for key in given:
        first_of.setdefault(_GROUPS[key], key)
    if not first_of:
        if path not in misspelt:
            yield _at("R2B113", f"{name} does not define what to run", root, path, _KIND_HELP)
        return
    if len(first_of) > 1:
        first, second = list(first_of.values())[:2]
        yield _both_of(name, path, node, (first, second), "R2B113", _KIND_HELP)
        return
    group = next(iter(first_of))
    alike = members(group)
    if len(alike) > 1:
        markers = [key for key in given if key != group]
        if len(markers) > 1:
            yield _both_of(name, path, node, (markers[0], markers[1]), "R2B113", _KIND_HELP)
            return
        if len(given) == 1 and path not in misspelt:
            yield _incomplete(name, path, given[0], group, root)
            return
    kind = next((each for each in alike if each.marker in given), alike[-1])
    for key, refusal in kind.refuses.items():
        if key in node.entries:
            message = f"{name} cannot have '{key}': {refusal.why}"
            help_text = refusal.help or f"remove '{key}'"
            yield _at("R2B119", message, root, (*path, key), help_text)
    if "container" in node.entries:
        for key in (*PROCESS_KEYS, "env"):
            if key in node.entries:
                message = f"{name} cannot have '{key}': it shares its process with other nodes"
                help_text = f"move '{key}' to the container"
                yield _at("R2B119", message, root, (*path, key), help_text)


def _incomplete(name: str, path: Path, given: str, group: str, root: TreeNode) -> Diagnostic:
    """The diagnostic for a node that has one of the two keys of its kind."""
    alike = sorted(members(group), key=lambda kind: kind.marker)
    if given == group:
        missing = " and ".join(f"no '{each.marker}'" for each in alike)
        message = f"{name} has '{group}' but {missing}"
        help_text = f"add one of them; see {' or '.join(repr(each.listed_by) for each in alike)}"
    else:
        message = f"{name} has '{given}' but no '{group}'"
        listed = next(each.listed_by for each in alike if each.marker == given)
        help_text = f"add '{group}'; see '{listed}'"
    return _at("R2B113", message, root, (*path, given), help_text)


def _is_false(node: MapNode, key: str) -> bool:
    value = node.entries[key].value
    return isinstance(value, ScalarNode) and value.value is False


def _bags(root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    loader = child(root, "data_loader")
    if not isinstance(loader, MapNode):
        return
    place: Path = ("data_loader",)
    given = [key for key in loader.entries if key in ("bag", "bags")]
    if len(given) == 2:
        help_text = "list all recordings under 'bags'"
        yield _both_of("'data_loader'", place, loader, (given[0], given[1]), "R2B114", help_text)
    elif not given and place not in misspelt:
        message = "'data_loader' needs 'bag' or 'bags'"
        yield _at("R2B114", message, root, place, "add 'bag: r2b_storage', or 'bag: ./a/bag'")
    bag, bags = child(loader, "bag"), child(loader, "bags")
    if isinstance(bag, MapNode):
        yield from _bag(bag, (*place, "bag"), root, misspelt)
    if isinstance(bags, ListNode):
        if not bags.items:
            message = "'data_loader.bags' must not be empty"
            yield _at("R2B108", message, root, (*place, "bags"), "for example: [./a/bag]")
        for index, each in enumerate(bags.items):
            if isinstance(each, MapNode):
                yield from _bag(each, (*place, "bags", index), root, misspelt)


def _bag(bag: MapNode, path: Path, root: TreeNode, misspelt: set[Path]) -> Iterator[Diagnostic]:
    name = f"'{format_path(path)}'"
    given = [key for key in bag.entries if key in ("dataset", "path")]
    if len(given) == 2:
        help_text = "keep one of them"
        yield _both_of(name, path, bag, (given[0], given[1]), "R2B114", help_text)
    elif not given and path not in misspelt:
        help_text = "add 'dataset: r2b_storage', or 'path: ./a/bag'"
        yield _at("R2B114", f"{name} needs 'dataset' or 'path'", root, path, help_text)


def _both_of(
    name: str, path: Path, node: MapNode, keys: tuple[str, str], code: str, help_text: str
) -> Diagnostic:
    first, second = keys
    return Diagnostic(
        code,
        Severity.ERROR,
        f"{name} has both '{first}' and '{second}'",
        node.entries[second].key_span,
        path=(*path, second),
        help=help_text,
        related=(Related("the other key", node.entries[first].key_span),),
    )


def _at(code: str, message: str, root: TreeNode, path: Path, help_text: str) -> Diagnostic:
    span = span_at(root, path, key=True)
    return Diagnostic(code, Severity.ERROR, message, span, path=path, help=help_text)
