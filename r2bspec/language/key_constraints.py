"""Constraints between keys: which exclude each other, need each other, or have no effect.

JSON Schema's ``oneOf`` could express some of them, but its messages are hard to understand, and
completion with it is poor. They are checked on the tree, so that they are reported in a document
with other mistakes, too.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from r2bspec.diagnostics import Diagnostic, Path, Related, Span, format_path
from r2bspec.diagnostics.quote import unknown_name_help
from r2bspec.language import located_tree as tree
from r2bspec.language.node_kinds import NODE_KIND_KEYS, NODE_KINDS, Refusal, kinds_help, members
from r2bspec.language.quantities import QuantityError, Rate, Share
from r2bspec.language.spec_benchmark import ACCEPTED, FEEDBACK, MAX_DROPOUT
from r2bspec.language.spec_graph import PROCESS_KEYS
from r2bspec.safe_io.limits import MAX_PLANNED_ITERATIONS, MAX_RANGE_RATES, MAX_REQUIREMENTS

_PROBES: Final = {
    "ready": ("file", "service", "log", "topic"),
    "after_ready": ("command", "service"),
}
"""The keys of which each entry of a section has exactly one."""

_NODE_MAPS: Final[tuple[Path, ...]] = (("preprocessors",), ("graph", "nodes"))
_GROUPS: Final = {key: kind.group for kind in NODE_KINDS for key in kind.keys}
_INTRA_PROCESS: Final = "use_intra_process_comms"
_KIND_HELP: Final = f"use one of {kinds_help()}"
_NOT_STARTED: Final = Refusal("r2bspec does not start its processes")
_SHARED: Final = Refusal("it shares its process with other nodes", "move it to the container")


def key_constraint_errors(
    root: tree.TreeNode, violations: Sequence[Diagnostic] = ()
) -> Iterator[Diagnostic]:
    """Return diagnostics of the violated constraints of a document.

    Args:
        root: the document.
        violations: what is wrong with it otherwise: a map with an unknown key may have the missing
            key in a misspelt form.
    """
    misspelt = {violation.path[:-1] for violation in violations if violation.code == "R2B101"}
    document = _Document(root, misspelt)
    for section in _NODE_MAPS:
        for path, node in document.entries(section):
            yield from _node(document, node, path)
            yield from _policies(document, path)
            yield from _launch(document, (*path, "launch"))
    for path, _ in document.entries(("containers",)):
        yield from _policies(document, path)
        if document.word(*path, "executable") == "python":
            why = ": a container of Python nodes has no arguments"
            yield from document.without_effect([(*path, "arguments")], why, "remove '{key}'")
    yield from _bags(document)
    for name, keys in _PROBES.items():
        listed = ", ".join(f"'{key}'" for key in keys[:-1]) + f" or '{keys[-1]}'"
        for path, _ in document.entries((name,)):
            yield from document.one_of(
                path, keys, "R2B118", f"one of {listed}", f"add one of {listed}", "only "
            )
    yield from _playback(document)
    yield from _harness(document)
    yield from _uncounted_outputs(document)
    yield from _transport(document)
    yield from _benchmark(document)
    yield from _conditions(document)
    yield from _requirements(document)


class _Document:
    """A tree, and what the constraints ask of it; `misspelt` are maps with an unknown key."""

    def __init__(self, root: tree.TreeNode, misspelt: set[Path]) -> None:
        self.root = root
        self.misspelt = misspelt

    def map_at(self, *path: str | int) -> tree.MapNode | None:
        """Return the map at a path, or None."""
        node = tree.lookup(self.root, path)
        return node if isinstance(node, tree.MapNode) else None

    def keys(self, *path: str | int) -> Sequence[str]:
        """Return the keys of the map at a path; none if there is no map."""
        return tuple(tree.entries_of(tree.lookup(self.root, path)))

    def entries(self, section: Path) -> Iterator[tuple[Path, tree.MapNode]]:
        """Yield the entries of a section that are maps, with their paths."""
        for name, entry in tree.entries_of(tree.lookup(self.root, section)).items():
            if isinstance(entry.value, tree.MapNode):
                yield (*section, name), entry.value

    def word(self, *path: str | int) -> str:
        """Return the text at a path, or an empty one."""
        return tree.text_of(tree.lookup(self.root, path))

    def number(self, path: Path, default: int) -> int | None:
        """Return the integer at a path, its default, or None for another value."""
        value = tree.lookup(self.root, path)
        if value is None:
            return default
        number = value.value if isinstance(value, tree.ScalarNode) else None
        return number if type(number) is int else None

    def rate(self, *path: str | int) -> Rate | None:
        """Return the rate at a path, or None."""
        try:
            return Rate.parse(self.word(*path))
        except QuantityError:
            return None

    def error(
        self,
        path: Path,
        message: str,
        help_text: str,
        code: str = "R2B119",
        *,
        span: Span | None = None,
        related: tuple[Related, ...] = (),
    ) -> Diagnostic:
        """Return an error at a key, or at `span`."""
        place = span or tree.span_at(self.root, path, key=True)
        return Diagnostic.error(code, message, place, help_text, path=path, related=related)

    def both(self, path: Path, keys: Sequence[str], help_text: str, code: str) -> Diagnostic:
        """Return an error for the second of two keys that exclude each other."""
        first, second = keys[:2]
        message = f"'{format_path(path)}' has both '{first}' and '{second}'"
        other = Related("the other key", tree.span_at(self.root, (*path, first), key=True))
        return self.error((*path, second), message, help_text, code, related=(other,))

    def one_of(
        self, path: Path, keys: Sequence[str], code: str, needs: str, help_text: str, only: str = ""
    ) -> Iterator[Diagnostic]:
        """Yield an error unless the map at a path has exactly one of some keys."""
        given = [key for key in self.keys(*path) if key in keys]
        if len(given) > 1:
            keep = f"keep {only}{needs}" if only else "keep one of them"
            yield self.both(path, given, keep, code)
        elif not given and path not in self.misspelt:
            node = tree.lookup(self.root, path)
            span = node.span if node is not None and code == "R2B118" else None
            message = f"'{format_path(path)}' needs {needs}"
            yield self.error(path, message, help_text, code, span=span)

    def without_effect(
        self, paths: Iterable[Path], why: str, help_text: str
    ) -> Iterator[Diagnostic]:
        """Yield an error for each of some keys that is written.

        ``{key}`` in the help is the key.
        """
        for path in paths:
            if tree.lookup(self.root, path) is not None:
                message = f"'{format_path(path)}' has no effect{why}"
                yield self.error(path, message, help_text.format(key=path[-1]))


def _node(document: _Document, node: tree.MapNode, path: Path) -> Iterator[Diagnostic]:
    """Yield the keys of one kind, and none that the kind refuses."""
    given = [key for key in node.entries if key in NODE_KIND_KEYS and not _is_false(node, key)]
    name = f"'{format_path(path)}'"
    first_of: dict[str, str] = {}
    for key in given:
        first_of.setdefault(_GROUPS[key], key)
    if not first_of:
        if path not in document.misspelt:
            message = f"{name} does not define what to run"
            yield document.error(path, message, _KIND_HELP, "R2B113")
        return
    group = next(iter(first_of))
    several = [*first_of.values()] if len(first_of) > 1 else [key for key in given if key != group]
    if len(several) > 1:
        yield document.both(path, several, _KIND_HELP, "R2B113")
        return
    alike = members(group)
    if len(alike) > 1 and len(given) == 1 and path not in document.misspelt:
        yield _incomplete(document, path, given[0], group)
        return
    kind = next((kind_ for kind_ in alike if kind_.marker in given), alike[-1])
    refused = dict(kind.refuses)
    if kind.by_others:
        refused |= dict.fromkeys(PROCESS_KEYS, _NOT_STARTED)
    if "container" in node.entries:
        refused = dict.fromkeys((*PROCESS_KEYS, "env"), _SHARED) | refused
    for key, refusal in refused.items():
        if key in node.entries:
            message = f"{name} cannot have '{key}': {refusal.why}"
            yield document.error((*path, key), message, refusal.help or f"remove '{key}'")
    if _INTRA_PROCESS in document.keys(*path, "extra_arguments"):
        message = f"'{_INTRA_PROCESS}' of {name} has a key of its own"
        help_text = "write 'intra_process' in the node instead"
        yield document.error((*path, "extra_arguments", _INTRA_PROCESS), message, help_text)


def _policies(document: _Document, path: Path) -> Iterator[Diagnostic]:
    """Policies of real time have a priority, and others have none."""
    scheduling = (*path, "scheduling")
    threads = (*scheduling, "threads")
    number = len(tree.items_of(tree.lookup(document.root, threads)))
    for place in (scheduling, *((*threads, index) for index in range(number))):
        policy, priority = document.word(*place, "policy"), document.number((*place, "priority"), 0)
        if policy in {"fifo", "rr"}:
            if priority == 0:
                message = f"the policy {policy} needs a priority"
                yield document.error((*place, "policy"), message, "add 'priority', from 1 to 99")
        elif priority:
            message = f"'{format_path((*place, 'priority'))}' has no effect without real time"
            yield document.error((*place, "priority"), message, "use 'nice', or 'policy: fifo'")


def _incomplete(document: _Document, path: Path, given: str, group: str) -> Diagnostic:
    """Return the diagnostic for a node that has one of the two keys of its kind."""
    alike = sorted(members(group), key=lambda kind: kind.marker)
    name = f"'{format_path(path)}'"
    if given == group:
        missing = " and ".join(f"no '{kind_.marker}'" for kind_ in alike)
        message = f"{name} has '{group}' but {missing}"
        help_text = f"add one of them; see {' or '.join(repr(kind_.listed_by) for kind_ in alike)}"
    else:
        message = f"{name} has '{given}' but no '{group}'"
        listed = next(kind_.listed_by for kind_ in alike if kind_.marker == given)
        help_text = f"add '{group}'; see '{listed}'"
    return document.error((*path, given), message, help_text, "R2B113")


def _is_false(node: tree.MapNode, key: str) -> bool:
    value = node.entries[key].value
    return isinstance(value, tree.ScalarNode) and value.value is False


def _launch(document: _Document, path: Path) -> Iterator[Diagnostic]:
    launch = document.map_at(*path)
    if launch is None:
        return
    given = [key for key in launch.entries if key in ("package", "file", "path")]
    help_text = "set 'package' and 'file', or 'path'"
    if "path" in given and len(given) > 1:
        other = next(key for key in given if key != "path")
        keys = sorted(("path", other), key=given.index)
        yield document.both(path, keys, help_text, "R2B118")
    elif len(given) < 2 and "path" not in given and path not in document.misspelt:
        lacks = {"package": "'file'", "file": "'package'"}.get("".join(given), "a launch file")
        message = f"'{format_path(path)}' needs {lacks}"
        yield document.error(path, message, help_text, "R2B118", span=launch.span)


def _bags(document: _Document) -> Iterator[Diagnostic]:
    """One recording or several, each with one source."""
    place: Path = ("data_loader",)
    loader = document.map_at(*place)
    if loader is None:
        return
    given = [key for key in loader.entries if key in ("bag", "bags")]
    if len(given) == 2:
        yield document.both(place, given, "list all recordings under 'bags'", "R2B114")
    elif not given and place not in document.misspelt:
        help_text = "add 'bag: r2b_storage', or 'bag: ./a/bag'"
        yield document.error(place, "'data_loader' needs 'bag' or 'bags'", help_text, "R2B114")
    bags = tree.child(loader, "bags")
    if isinstance(bags, tree.ListNode) and not bags.items:
        message = "'data_loader.bags' must not be empty"
        yield document.error((*place, "bags"), message, "for example: [./a/bag]", "R2B108")
    number = len(tree.items_of(bags))
    for path in ((*place, "bag"), *((*place, "bags", index) for index in range(number))):
        if document.map_at(*path) is not None:
            help_text = "add 'dataset: r2b_storage', or 'path: ./a/bag'"
            keys = ("dataset", "path")
            yield from document.one_of(path, keys, "R2B114", "'dataset' or 'path'", help_text)


def _playback(document: _Document) -> Iterator[Diagnostic]:
    playback = document.map_at("playback")
    if playback is None:
        return
    mode = document.word("playback", "mode") if "mode" in playback.entries else "looping"
    yield from _calls(document, mode)
    if mode == "live" and document.map_at("playback", "calls") is None:
        unused = [("playback", key) for key in ("inputs", "buffer", "unpaired", "clock")]
        yield from document.without_effect(
            [("data_loader",), ("preprocessors",), *unused],
            ": a live benchmark plays nothing",
            "remove '{key}', or change playback.mode",
        )
    if mode and mode != "timeline":
        yield from document.without_effect(
            [("playback", key) for key in ("timeline", "record_timeline", "tf")],
            f" with mode {mode}",
            f"remove it, or write 'mode: timeline' instead of '{mode}'",
        )
    yield from _arrivals(document, mode)
    yield from _recorded_rates(document, mode)
    yield from _translations(document)


def _arrivals(document: _Document, mode: str) -> Iterator[Diagnostic]:
    path: Path = ("playback", "arrivals")
    if mode in {"timeline", "live"}:
        why = f": with mode {mode} the {'recording' if mode == 'timeline' else 'graph'} sets them"
        yield from document.without_effect([path], why, "remove it, or write 'mode: looping'")
        return
    if document.map_at(*path) is None:
        return
    kind = document.word(*path, "kind") or "fixed"
    unused = {"bursts": (), "jitter": ("size",), "dropout": ("size",), "poisson": ("size", "share")}
    keys = unused.get(kind, ("size", "share", "seed"))
    paths = [(*path, key) for key in keys]
    yield from document.without_effect(paths, f" with {kind} arrivals", "remove it")
    if kind in {"jitter", "dropout"} and "share" not in document.keys(*path):
        yield document.error(path, f"{kind} needs a share", "add 'share: 20 %'", "R2B118")
    with contextlib.suppress(QuantityError):
        most = Share(MAX_DROPOUT if kind == "dropout" else 1.0)
        if Share.parse(document.word(*path, "share")).fraction > most.fraction:
            yield document.error((*path, "share"), f"the share is more than {most}", "reduce it")


def _calls(document: _Document, mode: str) -> Iterator[Diagnostic]:
    """Services are called in each step, by a process of its own."""
    calls: Path = ("playback", "calls")
    if document.map_at(*calls) is None:
        return
    if not document.keys(*calls):
        yield document.error(
            calls, "'playback.calls' must not be empty", "name a service", "R2B108"
        )
    plays = document.map_at("playback", "inputs") is not None
    recorded = [(*path, "from") for path, call in document.entries(calls) if "from" in call.entries]
    if not plays:
        keys = ("buffer", "unpaired", "pairing", "clock", "record_timeline", "tf")
        unused: list[Path] = [("preprocessors",), *(("playback", key) for key in keys)]
        yield from document.without_effect(
            unused if recorded else [("data_loader",), *unused],
            ": services are called, and no topic is played",
            "remove '{key}', or add 'playback.inputs'",
        )
    elif mode == "timeline":
        for path in recorded:
            message = "with inputs, recorded requests are not sent at their recorded times"
            help_text = "remove 'playback.inputs', or 'mode: timeline' to send one in each step"
            yield document.error(path, message, help_text)
    modes = ("", "looping", "timeline") if recorded else ("", "looping")
    if mode == "live" or (mode not in modes and not plays):
        message = f"services cannot be called with 'mode: {mode}'"
        if mode != "live":
            message += " where no topic is played"
            message += " and no request is recorded" if mode == "timeline" else ""
        yield document.error(("playback", "mode"), message, "remove it, or 'playback.calls'")
    for section, refused in (("harness", ("shared", "graph")), ("graph", ("harness",))):
        placement = document.word(section, "placement") or document.word(section)
        if placement in refused:
            message = f"services are called by a process of its own, not with placement {placement}"
            help_text = "remove the placement, or 'playback.calls'"
            yield document.error((section,), message, help_text)
    taken: dict[str, Path] = {name: ("monitors", name) for name in document.keys("monitors")}
    for name in document.keys(*calls):
        call: Path = (*calls, name)
        needs = "'service' or 'action'"
        kinds = ("service", "action")
        yield from document.one_of(call, kinds, "R2B118", needs, f"add {needs}")
        is_action = "action" in document.keys(*call)
        if (*call, "from") in recorded:
            why = ": the requests are those of the recording, 'from'"
            yield from document.without_effect([(*call, "each")], why, "remove it, or 'from'")
        other, owner = ("success", "a service") if is_action else ("feedback", "an action")
        yield from document.without_effect([(*call, other)], f": it is of {owner}", "remove it")
        ends = ("", ACCEPTED, FEEDBACK) if is_action else ("",)
        for measured in (f"{name}{end}" for end in ends):
            if measured in taken:
                message = f"'{measured}' is measured twice: it is the name of something else, too"
                there = Related(
                    "the other one", tree.span_at(document.root, taken[measured], key=True)
                )
                yield document.error(call, message, "rename one of them", related=(there,))
            taken.setdefault(measured, call)


def _recorded_rates(document: _Document, mode: str) -> Iterator[Diagnostic]:
    """Inputs with a rate of their own, and latched ones, need others that make steps."""
    section = ("playback", "inputs")
    rates = [(*path, "rate") for path, _ in document.entries(section)]
    recorded = [path for path in rates if document.word(*path) == "recorded"]
    latched = [path for path in rates if document.word(*path) == "once"]
    if mode == "timeline":
        why = " with mode timeline, which plays every input at its recorded times"
        yield from document.without_effect(recorded, why, "remove it")
        recorded = []
    own = recorded + latched
    if own and len(own) == len(document.keys(*section)):
        message = "no input makes steps: all of them have a 'rate' of their own"
        help_text = "remove it from the input whose rate is offered"
        help_text += ", or write 'mode: timeline'" if recorded else ""
        yield from (document.error(path, message, help_text) for path in own)


def _translations(document: _Document) -> Iterator[Diagnostic]:
    inputs = document.map_at("playback", "inputs")
    path = ("playback", "timeline", "translations")
    translations = tree.entries_of(tree.lookup(document.root, path))
    for topic, entry in translations.items():
        if inputs is not None and topic not in inputs.entries and entry.key_resolved:
            help_text = unknown_name_help(topic, inputs.entries, "inputs")
            yield document.error((*path, topic), f"unknown playback input '{topic}'", help_text)


def _harness(document: _Document) -> Iterator[Diagnostic]:
    """Processes of the graph are named only where the harness runs in them."""
    if "graph" in (document.word("harness"), document.word("harness", "placement")):
        return
    owners = [("harness",), *(path for path, _ in document.entries(("monitors",)))]
    yield from document.without_effect(
        [(*path, "in") for path in owners],
        ": player and monitors do not run in the processes of the graph",
        "remove it, or write 'harness: {{placement: graph}}'",
    )


def _uncounted_outputs(document: _Document) -> Iterator[Diagnostic]:
    """Yield where no number of outputs is expected there is no ratio.

    A timer has no path of stamps.
    """
    kinds = {
        "own_pace": (("ratio",), "its outputs answer no input"),
        "any": (("ratio",), "an input may have any number of outputs"),
    }
    for match, (keys, why) in kinds.items():
        monitors = [path for path, _ in document.entries(("monitors",))]
        yield from document.without_effect(
            [
                (*path, key)
                for path in monitors
                if document.word(*path, "match") == match
                for key in keys
            ],
            f" with 'match: {match}': {why}",
            "remove '{key}', or match by stamp or by order",
        )


def _transport(document: _Document) -> Iterator[Diagnostic]:
    kind = document.word("transport", "kind")
    if kind not in ("", "shared_memory"):
        yield from document.without_effect(
            [("transport", "segment")],
            f" with {kind}: only shared_memory has segments",
            "remove it, or write 'kind: shared_memory'",
        )
    if document.map_at("network") is None:
        return
    if (kind or document.word("transport")) != "udp":
        message = "messages in shared memory do not pass the network"
        help_text = "write 'transport: udp', or remove 'network'"
        yield document.error(("network",), message, help_text)
    for path, node in document.entries(("graph", "nodes")):
        if "external" in node.entries:
            message = f"external node {path[-1]} is not in the network of the run"
            help_text = "let the run start it, or remove 'network'"
            yield document.error((*path, "external"), message, help_text)
    if "jitter" in document.keys("network") and "delay" not in document.keys("network"):
        yield document.error(("network", "jitter"), "jitter needs a delay", "add 'delay'")


def _benchmark(document: _Document) -> Iterator[Diagnostic]:
    if document.map_at("benchmark") is None:
        return
    path: Path = ("benchmark", "max_iterations")
    iterations = document.number(("benchmark", "iterations"), 10)
    max_iterations = document.number(path, 0)
    if iterations is not None and max_iterations and max_iterations < iterations:
        message = (
            f"'benchmark.max_iterations' ({max_iterations}) is less than 'iterations' "
            f"({iterations})"
        )
        yield document.error(path, message, f"use at least {iterations}")
    if document.map_at("benchmark", "rates") is not None:
        yield from _range(document)
    planned = max(iterations or 0, max_iterations or 0) * _number_of_rates(document)
    if planned > MAX_PLANNED_ITERATIONS:
        message = (
            f"{planned:,} iterations at all rates together; the limit is {MAX_PLANNED_ITERATIONS:,}"
        )
        yield document.error(("benchmark",), message, "use fewer, or split the spec", "R2B129")


def _number_of_rates(document: _Document) -> int:
    """Return how many rates are listed, or are in a valid range; 1 where that is not known."""
    path: Path = ("benchmark", "rates")
    listed = tree.lookup(document.root, path)
    if isinstance(listed, tree.ListNode):
        return len(listed.items)
    first, last, step = (document.rate(*path, key) for key in ("from", "to", "step"))
    if first is not None and last is not None and step is not None and step.is_positive:
        number = (last.hz - first.hz) / step.hz
        return int(number) + 1 if 0 < number < MAX_RANGE_RATES else 1
    return document.number((*path, "count"), 1) or 1


def _range(document: _Document) -> Iterator[Diagnostic]:
    path: Path = ("benchmark", "rates")
    keys, help_text = ("step", "count"), "add 'step: 10 Hz', or 'count: 6'"
    unclear = list(document.one_of(path, keys, "R2B118", "'step' or 'count'", help_text))
    first, last, step = (document.rate(*path, key) for key in ("from", "to", "step"))
    if unclear or first is None or last is None:
        yield from unclear
    elif first.hz >= last.hz:
        message = f"the range of rates is empty: 'to' ({last}) is not above 'from' ({first})"
        yield document.error((*path, "to"), message, "swap the two, or write a list of rates")
    elif step is not None and step.is_positive:
        if step.hz > last.hz - first.hz:
            message = f"a step of {step} is larger than the range from {first} to {last}"
            yield document.error((*path, "step"), message, "use a smaller step")
        elif (last.hz - first.hz) / step.hz >= MAX_RANGE_RATES:
            message = f"the range has more than {MAX_RANGE_RATES:,} rates"
            yield document.error((*path, "step"), message, "use a larger step")


def _conditions(document: _Document) -> Iterator[Diagnostic]:
    """Variables in the `when` of objectives."""
    declared = document.keys("variables")
    for path, _ in document.entries(("slos",)):
        for name in document.keys(*path, "when"):
            if name not in declared:
                message, if_none = f"unknown variable '{name}'", "declare it under 'variables'"
                help_text = unknown_name_help(name, sorted(declared), "declared variables", if_none)
                yield document.error((*path, "when", name), message, help_text, "R2B120")


def _requirements(document: _Document) -> Iterator[Diagnostic]:
    """Yield the requirements of all objectives together have a limit."""
    lists = (tree.child(objective, "require") for _, objective in document.entries(("slos",)))
    number = sum(len(tree.items_of(listed)) for listed in lists)
    if number > MAX_REQUIREMENTS:
        message = f"{number:,} requirements; the limit is {MAX_REQUIREMENTS:,}"
        yield document.error(("slos",), message, "split the spec", "R2B129")
