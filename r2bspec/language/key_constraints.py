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
from r2bspec.diagnostics.quote import join_words, unknown_name_help
from r2bspec.language import located_tree as tree
from r2bspec.language.node_kinds import NODE_KIND_KEYS, NODE_KINDS, kinds_text
from r2bspec.language.quantities import QuantityError, Rate, Share
from r2bspec.language.spec_benchmark import ACCEPTED, FEEDBACK, MAX_DROPOUT, Benchmark
from r2bspec.language.spec_graph import PROCESS_KEYS
from r2bspec.safe_io.limits import MAX_RANGE_RATES

_NODE_MAPS: Final[tuple[Path, ...]] = (("preprocessors",), ("graph", "nodes"))
_INTRA_PROCESS: Final = "use_intra_process_comms"


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
            yield from _launch(document, (*path, "launch"))
    yield from _single_keys(document)
    for paths, why, instead in _keys_without_effect(document):
        yield from document.without_effect(paths, why, instead)
    for check in (_policies, _arrivals, _calls, _own_rates, _network, _benchmark, _names):
        yield from check(document)


class _Document:
    """A tree, and what the constraints ask of it; `misspelt` are maps with an unknown key."""

    def __init__(self, root: tree.TreeNode, misspelt: set[Path]) -> None:
        self.root = root
        self.misspelt = misspelt

    def has_map(self, *path: str | int) -> bool:
        """Return whether there is a map at a path."""
        return isinstance(tree.lookup(self.root, path), tree.MapNode)

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
        with contextlib.suppress(QuantityError):
            return Rate.parse(self.word(*path))
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

    def one_of(self, path: Path, keys: Sequence[str], code: str) -> Iterator[Diagnostic]:
        """Yield an error unless the map at a path has exactly one of some keys."""
        given = [key for key in self.keys(*path) if key in keys]
        listed = join_words([f"'{key}'" for key in keys])
        if len(given) > 1:
            first, second = given[:2]
            message = f"'{format_path(path)}' has both '{first}' and '{second}'"
            other = Related("the other key", tree.span_at(self.root, (*path, first), key=True))
            yield self.error((*path, second), message, "keep one of them", code, related=(other,))
        elif not given and path not in self.misspelt:
            node = tree.lookup(self.root, path)
            span = node.span if node is not None and code == "R2B118" else None
            message = f"'{format_path(path)}' needs {listed}"
            yield self.error(path, message, f"add {listed}", code, span=span)

    def without_effect(
        self, paths: Iterable[Path], why: str, instead: str = ""
    ) -> Iterator[Diagnostic]:
        """Yield an error for each of some keys that is written."""
        for path in paths:
            if tree.lookup(self.root, path) is not None:
                message = f"'{format_path(path)}' has no effect{why}"
                help_text = f"remove '{path[-1]}'" + (f", or {instead}" if instead else "")
                yield self.error(path, message, help_text)


def _node(document: _Document, node: tree.MapNode, path: Path) -> Iterator[Diagnostic]:
    """Yield what is wrong with the keys of a kind, and those that the kind refuses."""
    given = [key for key in node.entries if key in NODE_KIND_KEYS and not _is_false(node, key)]
    name = f"'{format_path(path)}'"
    kind = next((kind for kind in NODE_KINDS if set(kind.keys) == set(given)), None)
    if kind is None:
        if path not in document.misspelt or len(given) > 1:
            listed = join_words([f"'{key}'" for key in given], "and")
            message = f"{name} has {listed}, and needs the keys of one kind of node"
            if not given:
                message = f"{name} does not define what to run"
            place = (*path, *given[-1:])
            yield document.error(place, message, f"use one of {kinds_text()}", "R2B113")
        return
    refused = dict(kind.refuses)
    if kind.by_others:
        refused |= dict.fromkeys(PROCESS_KEYS, "r2bspec does not start its processes")
    if "container" in node.entries:
        shared = "it shares its process with other nodes; its container may have it"
        refused = dict.fromkeys((*PROCESS_KEYS, "env"), shared) | refused
    for key, why in refused.items():
        if key in node.entries:
            message = f"{name} cannot have '{key}': {why}"
            yield document.error((*path, key), message, f"remove '{key}'")
    if _INTRA_PROCESS in document.keys(*path, "extra_arguments"):
        message = f"'{_INTRA_PROCESS}' of {name} has a key of its own"
        help_text = "write 'intra_process' in the node instead"
        yield document.error((*path, "extra_arguments", _INTRA_PROCESS), message, help_text)


def _is_false(node: tree.MapNode, key: str) -> bool:
    value = node.entries[key].value
    return isinstance(value, tree.ScalarNode) and value.value is False


def _launch(document: _Document, path: Path) -> Iterator[Diagnostic]:
    launch = tree.lookup(document.root, path)
    given = {key for key in document.keys(*path) if key in ("package", "file", "path")}
    if "path" in given:
        yield from document.one_of(path, ("path", "package", "file"), "R2B118")
    elif isinstance(launch, tree.MapNode) and len(given) < 2 and path not in document.misspelt:
        message = f"'{format_path(path)}' needs 'package' and 'file', or 'path'"
        yield document.error(path, message, "name a launch file", "R2B118", span=launch.span)


def _single_keys(document: _Document) -> Iterator[Diagnostic]:
    """Yield the maps without exactly one of several keys."""
    loader: Path = ("data_loader",)
    if document.has_map(*loader):
        yield from document.one_of(loader, ("bag", "bags"), "R2B114")
    number = len(tree.items_of(tree.lookup(document.root, (*loader, "bags"))))
    for path in ((*loader, "bag"), *((*loader, "bags", index) for index in range(number))):
        if document.has_map(*path):
            yield from document.one_of(path, ("dataset", "path"), "R2B114")
    sections: dict[Path, Sequence[str]] = {
        ("ready",): ("file", "service", "log", "topic"),
        ("after_ready",): ("command", "service"),
        ("playback", "calls"): ("service", "action"),
    }
    for section, keys in sections.items():
        for path, _ in document.entries(section):
            yield from document.one_of(path, keys, "R2B118")


def _keys_without_effect(document: _Document) -> Iterator[tuple[Iterable[Path], str, str]]:
    """Yield keys that have no effect together with others, why, and what to do instead."""

    def playback(*keys: str) -> list[Path]:
        return [("playback", key) for key in keys]

    mode = document.word("playback", "mode") or "looping"
    if "mode" in document.keys("playback") and not document.word("playback", "mode"):
        mode = ""  # wrong otherwise
    calls = [path for path, _ in document.entries(("playback", "calls"))]
    if mode == "live" and not document.has_map("playback", "calls"):
        unused = playback("inputs", "buffer", "unpaired", "clock")
        why = ": a live benchmark plays nothing"
        yield [("data_loader",), ("preprocessors",), *unused], why, "change playback.mode"
    if mode not in ("", "timeline"):
        unused = playback("timeline", "record_timeline", "tf")
        yield unused, f" with mode {mode}", "write 'mode: timeline'"
    if mode in {"timeline", "live"}:
        why = f": with mode {mode} the {'recording' if mode == 'timeline' else 'graph'} sets them"
        yield playback("arrivals"), why, "write 'mode: looping'"
    elif document.has_map("playback", "arrivals"):
        kind = document.word("playback", "arrivals", "kind") or "fixed"
        used = {"bursts": ("size", "share", "seed"), "poisson": ("seed",)}
        used |= dict.fromkeys(("jitter", "dropout"), ("share", "seed"))
        keys = {"size", "share", "seed"} - {*used.get(kind, ())}
        paths: list[Path] = [("playback", "arrivals", key) for key in sorted(keys)]
        yield paths, f" with {kind} arrivals", ""
    if calls and not document.has_map("playback", "inputs"):
        unused = playback("buffer", "unpaired", "pairing", "clock", "record_timeline", "tf")
        recorded = any("from" in document.keys(*path) for path in calls)
        data: list[Path] = [] if recorded else [("data_loader",)]
        why = ": services are called, and no topic is played"
        yield [*data, ("preprocessors",), *unused], why, "add 'playback.inputs'"
    for path in calls:
        if "from" in document.keys(*path):
            yield [(*path, "each")], ": the requests are those of the recording, 'from'", ""
        is_action = "action" in document.keys(*path)
        other, owner = ("success", "a service") if is_action else ("feedback", "an action")
        yield [(*path, other)], f": it is of {owner}", ""
    for path, _ in document.entries(("containers",)):
        if document.word(*path, "executable") == "python":
            yield [(*path, "arguments")], ": a container of Python nodes has no arguments", ""
    monitors = [path for path, _ in document.entries(("monitors",))]
    if "graph" not in (document.word("harness"), document.word("harness", "placement")):
        why = ": player and monitors do not run in the processes of the graph"
        owners: list[Path] = [("harness",), *monitors]
        yield [(*path, "in") for path in owners], why, "write 'harness: {placement: graph}'"
    for path in monitors:
        match = document.word(*path, "match")
        if match in {"own_pace", "any"}:
            why = f" with 'match: {match}', which counts no outputs of an input"
            yield [(*path, "ratio")], why, "match by stamp or by order"
    transport = document.word("transport", "kind")
    if transport not in ("", "shared_memory"):
        why = f" with {transport}: only shared_memory has segments"
        yield [("transport", "segment")], why, "write 'kind: shared_memory'"


def _policies(document: _Document) -> Iterator[Diagnostic]:
    """Policies of real time have a priority, and others have none."""
    for section in (*_NODE_MAPS, ("containers",)):
        for path, _ in document.entries(section):
            scheduling = (*path, "scheduling")
            threads = (*scheduling, "threads")
            number = len(tree.items_of(tree.lookup(document.root, threads)))
            for place in (scheduling, *((*threads, index) for index in range(number))):
                priority = document.number((*place, "priority"), 0)
                if document.word(*place, "policy") not in {"fifo", "rr"}:
                    if priority:
                        why = " without a policy of real time"
                        yield from document.without_effect(
                            [(*place, "priority")], why, "write 'policy: fifo'"
                        )
                elif priority == 0:
                    message = "a policy of real time needs a priority"
                    help_text = "add 'priority', from 1 to 99"
                    yield document.error((*place, "policy"), message, help_text)


def _arrivals(document: _Document) -> Iterator[Diagnostic]:
    path: Path = ("playback", "arrivals")
    kind = document.word(*path, "kind")
    if kind in {"jitter", "dropout"} and "share" not in document.keys(*path):
        yield document.error(path, f"{kind} needs a share", "add 'share: 20 %'", "R2B118")
    with contextlib.suppress(QuantityError):
        most = Share(MAX_DROPOUT if kind == "dropout" else 1.0)
        if Share.parse(document.word(*path, "share")) > most:
            yield document.error((*path, "share"), f"the share is more than {most}", "reduce it")


def _calls(document: _Document) -> Iterator[Diagnostic]:
    """Services are called in each step, by a process of its own."""
    calls = [path for path, _ in document.entries(("playback", "calls"))]
    if not calls:
        return
    mode = document.word("playback", "mode")
    plays = document.has_map("playback", "inputs")
    recorded = [(*path, "from") for path in calls if "from" in document.keys(*path)]
    if plays and mode == "timeline":
        for path in recorded:
            message = "with inputs, recorded requests are not sent at their recorded times"
            help_text = "remove 'playback.inputs', or 'mode: timeline' to send one in each step"
            yield document.error(path, message, help_text)
    modes = ("", "looping", "timeline") if recorded else ("", "looping")
    if mode == "live" or (mode not in modes and not plays):
        message = f"services cannot be called with 'mode: {mode}'"
        message += "" if mode == "live" else " where no topic is played"
        yield document.error(("playback", "mode"), message, "remove it, or 'playback.calls'")
    for section, refused in (("harness", ("shared", "graph")), ("graph", ("harness",))):
        placement = document.word(section, "placement") or document.word(section)
        if placement in refused:
            message = f"services are called by a process of its own, not with placement {placement}"
            help_text = "remove the placement, or 'playback.calls'"
            yield document.error((section,), message, help_text)
    taken: dict[str, Path] = {name: ("monitors", name) for name in document.keys("monitors")}
    for path in calls:
        ends = ("", ACCEPTED, FEEDBACK) if "action" in document.keys(*path) else ("",)
        for measured in (f"{path[-1]}{end}" for end in ends):
            if measured in taken:
                message = f"'{measured}' is measured twice: it is the name of something else, too"
                other = tree.span_at(document.root, taken[measured], key=True)
                related = (Related("the other one", other),)
                yield document.error(path, message, "rename one of them", related=related)
            taken.setdefault(measured, path)


def _own_rates(document: _Document) -> Iterator[Diagnostic]:
    """Inputs with a rate of their own, and latched ones, need others that make steps."""
    section = ("playback", "inputs")
    rates = [(*path, "rate") for path, _ in document.entries(section)]
    own = [path for path in rates if document.word(*path) == "once"]
    recorded = [path for path in rates if document.word(*path) == "recorded"]
    if document.word("playback", "mode") == "timeline":
        why = " with mode timeline, which plays every input at its recorded times"
        yield from document.without_effect(recorded, why)
    else:
        own += recorded
    if own and len(own) == len(document.keys(*section)):
        message = "no input makes steps: all of them have a 'rate' of their own"
        help_text = "remove it from the input whose rate is offered, or write 'mode: timeline'"
        yield from (document.error(path, message, help_text) for path in own)


def _network(document: _Document) -> Iterator[Diagnostic]:
    if not document.has_map("network"):
        return
    if (document.word("transport", "kind") or document.word("transport")) != "udp":
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
    path: Path = ("benchmark", "max_iterations")
    iterations = document.number(("benchmark", "iterations"), Benchmark().iterations)
    most = document.number(path, 0)
    if iterations is not None and most and most < iterations:
        message = f"'benchmark.max_iterations' ({most}) is less than 'iterations' ({iterations})"
        yield document.error(path, message, f"use at least {iterations}")
    path = ("benchmark", "rates")
    if not document.has_map(*path):
        return
    unclear = list(document.one_of(path, ("step", "count"), "R2B118"))
    yield from unclear
    first, last, step = (document.rate(*path, key) for key in ("from", "to", "step"))
    if unclear or first is None or last is None:
        return
    if first >= last:
        message = f"the range of rates is empty: 'to' ({last}) is not above 'from' ({first})"
        yield document.error((*path, "to"), message, "swap the two, or write a list of rates")
    elif step is not None and step.is_positive:
        number = (last.hz - first.hz) / step.hz
        if not 1 <= number < MAX_RANGE_RATES:
            few = (
                "is larger than the range" if number < 1 else f"makes over {MAX_RANGE_RATES} rates"
            )
            message = f"a step of {step} {few} from {first} to {last}"
            yield document.error((*path, "step"), message, "use another step, or 'count'")


def _names(document: _Document) -> Iterator[Diagnostic]:
    """Names that must be declared: variables in the `when` of objectives, inputs with delays."""
    declared = document.keys("variables")
    for path, _ in document.entries(("slos",)):
        for name in document.keys(*path, "when"):
            if name not in declared:
                message, if_none = f"unknown variable '{name}'", "declare it under 'variables'"
                help_text = unknown_name_help(name, sorted(declared), "declared variables", if_none)
                yield document.error((*path, "when", name), message, help_text, "R2B120")
    inputs = document.keys("playback", "inputs")
    section = ("playback", "timeline", "translations")
    translations = tree.entries_of(tree.lookup(document.root, section))
    for topic, entry in translations.items():
        if inputs and topic not in inputs and entry.key_resolved:
            message = f"unknown playback input '{topic}'"
            help_text = unknown_name_help(topic, inputs, "inputs")
            yield document.error((*section, topic), message, help_text)
