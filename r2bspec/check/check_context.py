"""The input of the rules: a spec, and facts about it that are computed on first use.

A bag is known at low cost: by its index, and by the times of its messages if it is small.

Reading a bag takes longer than all rules together: an editor reads it again only if it changes.

The messages in a window are counted in rendered datasets, in whole bags and where times are known.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from functools import cached_property, lru_cache
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Literal, NamedTuple

import msgspec

from r2bspec.bags.message_types import begins_with_header
from r2bspec.bags.recording import BagIndex, BagLocation, DataError, TimeWindow, merge_indexes
from r2bspec.datasets.catalogue import describe, locate
from r2bspec.datasets.catalogue import index as index_location
from r2bspec.diagnostics.diagnostic import Path
from r2bspec.judge.measure.metric import MetricInfo
from r2bspec.judge.measure.metric_catalogue import MetricError, Subjects, resolve
from r2bspec.language.benchmark_defaults import CONFIDENCE
from r2bspec.language.comparison_grammar import Requirement
from r2bspec.language.located_tree import MapNode, TreeNode, child, items_of, lookup
from r2bspec.language.quantities import Duration, Rate
from r2bspec.language.spec import Spec
from r2bspec.plan.installed_packages import package_version
from r2bspec.plan.nearest_stamps import clock_ahead
from r2bspec.plan.process_plans import process_names
from r2bspec.plan.topic_plans import direct_bag_topic
from r2bspec.plan.wiring.build_wiring import build_wiring
from r2bspec.plan.wiring.companion_files import CompanionFiles, CompanionReader
from r2bspec.plan.wiring.wiring import NodeWiring, Wiring

if TYPE_CHECKING:
    from r2bspec.bags.recorded_times import TopicTimes
    from r2bspec.language.load_spec import LoadedSpec


class LocatedRequirement(msgspec.Struct, frozen=True):
    """A requirement of an objective, or a condition of the search.

    Attributes:
        objective: the name of the objective; empty for a condition of the search.
        at: the rate of the objective.
        needs_rate: whether the objective has neither a rate nor the peak.
        confidence: the required confidence of its verdicts.
    """

    requirement: Requirement
    path: Path
    role: Literal["objective", "holds"]
    objective: str = ""
    at: Rate | None = None
    needs_rate: bool = False
    confidence: float = CONFIDENCE

    @property
    def metric_part(self) -> tuple[int, int]:
        """Offset and length of the metric in the requirement's text."""
        return (self.requirement.metric_column, len(self.requirement.metric))

    @property
    def bound_part(self) -> tuple[int, int]:
        """Offset and length of the bound in the requirement's text."""
        column = self.requirement.bound_column
        return (column, len(self.requirement.text.rstrip()) - column)

    @property
    def subject(self) -> str:
        """The key of the requirement as a subject of findings."""
        return f"requirement:{self.path}"


def located_requirements(spec: Spec) -> Iterator[LocatedRequirement]:
    """Yield the conditions of the search, then the requirements of all objectives."""
    if spec.benchmark.search is not None:
        for index, requirement in enumerate(spec.benchmark.search.holds):
            yield LocatedRequirement(requirement, ("benchmark", "search", "holds", index), "holds")
    for name, objective in spec.slos.items():
        for index, requirement in enumerate(objective.require):
            yield LocatedRequirement(
                requirement,
                ("slos", name, "require", index),
                "objective",
                name,
                objective.at,
                needs_rate=objective.at is None and not objective.at_peak,
                confidence=(objective.confidence or spec.benchmark.gate.confidence).fraction,
            )


class KnownMetric(LocatedRequirement, frozen=True, kw_only=True):
    """A requirement whose metric exists; `monitor` is None if it applies to no single monitor."""

    monitor: str | None
    info: MetricInfo


def max_wrong_share(metric: KnownMetric) -> float | None:
    """Return the share of messages that may violate the bound; None if no share decides."""
    requirement, info = metric.requirement, metric.info
    if requirement.bound is None:
        return None
    if requirement.bound.of_baseline or requirement.op not in {"<", "<=", ">", ">="}:
        return None
    ceiling = requirement.op in {"<", "<="}
    if info.statistic == "percentile" and info.quantile is not None:
        return 1 - info.quantile if ceiling else info.quantile
    if info.statistic == "share":
        return requirement.bound.value if ceiling else 1 - requirement.bound.value
    return None


class Recording(NamedTuple):
    """A bag of a spec: its path in the spec, its location, and its index or its error."""

    path: Path
    location: BagLocation | None
    content: BagIndex | None
    error: DataError | None


class DocumentFiles:
    """The companion files and bags of a document in a folder."""

    def __init__(self, base_dir: FilePath) -> None:
        self._base_dir = base_dir
        self._bags: dict[str, Recording] = {}

    @cached_property
    def companions(self) -> CompanionReader:
        """The reader of the companion files of every case."""
        return CompanionReader(self._base_dir)

    def recording(self, bag: str, path: Path) -> Recording:
        """Return the bag that a path of the spec names."""
        if bag not in self._bags:
            self._bags[bag] = self._recording(bag)
        return self._bags[bag]._replace(path=path)

    def _recording(self, bag: str) -> Recording:
        location = None
        try:
            location = locate(bag, self._base_dir)
            return Recording((), location, cached_index(location), None)
        except DataError as error:
            return Recording((), location, None, error)


class Context:
    """A spec, and what can be determined about it without executing anything.

    Attributes:
        loaded: the document.
        spec: its typed value.
        offline: whether to skip recorded data.
        files: the files of its document.
    """

    def __init__(
        self,
        loaded: LoadedSpec,
        spec: Spec,
        *,
        offline: bool = False,
        files: DocumentFiles | None = None,
    ) -> None:
        self.loaded = loaded
        self.spec = spec
        self.offline = offline
        self.files = DocumentFiles(loaded.base_dir) if files is None else files

    @cached_property
    def companion_files(self) -> CompanionFiles:
        """The companion files of the spec: interfaces, parameter files, Python files."""
        return self.files.companions.read(self.spec)

    @cached_property
    def wiring(self) -> Wiring:
        """The publishers and subscriptions of every topic."""
        types = self.bag.types(self.spec.data_loader.topics) if self.bag is not None else None
        return build_wiring(self.spec, bag_types=types, companion_files=self.companion_files)

    @cached_property
    def bag(self) -> BagIndex | None:
        """The index of all bags together; None offline, or if any of them cannot be used."""
        indexes = [bag.content for bag in self.recordings if bag.content is not None]
        return merge_indexes(indexes) if len(indexes) == len(self.recordings) else None

    @property
    def is_rendered(self) -> bool:
        """Whether the bag is a synthetic dataset."""
        return self.bag_location is not None and self.bag_location.path is None

    @property
    def bag_location(self) -> BagLocation | None:
        """The location of the bag; None offline, if it is not found, or if there are several."""
        return self.recordings[0].location if len(self.recordings) == 1 else None

    @cached_property
    def recordings(self) -> tuple[Recording, ...]:
        """Every bag of the spec; none offline, or if the spec has no bag."""
        if self.offline:
            return ()
        several = bool(self.spec.data_loader.bags)
        recordings = []
        for position, source in enumerate(self.spec.data_loader.sources):
            place: Path = ("data_loader", "bags", position) if several else ("data_loader", "bag")
            # A path without a '/' is still a path if the spec gives it as one.
            path = source.path if "/" in source.path or not source.path else f"./{source.path}"
            recordings.append(self.files.recording(path or source.dataset, self._name_path(place)))
        return tuple(recordings)

    def require_bags(self) -> list[BagIndex]:
        """Return the index of every bag.

        Raises:
            DataError: one of them cannot be used.
        """
        indexes = []
        for bag in self.recordings:
            if bag.content is None:
                assert bag.error is not None  # noqa: S101 - a recording has one or the other
                raise bag.error
            indexes.append(bag.content)
        return indexes

    def _name_path(self, place: Path) -> Path:
        """Return the path of the bag's name: its own value, or a key of it."""
        for key in ("dataset", "path"):
            if self.value_at((*place, key)) is not None:
                return (*place, key)
        return place

    def value_at(self, path: Path) -> TreeNode | None:
        """Return the value at a path of the document, or None."""
        return lookup(self.loaded.tree, path)

    def parameter_path(self, node: NodeWiring, name: str) -> Path | None:
        """Return where the spec sets a parameter of a node; None if a parameter file sets it.

        If several maps set it, the last map applies.
        """
        place: Path = (*node.path, "parameters")
        parameters_node = self.value_at(place)
        if isinstance(parameters_node, MapNode) or parameters_node is None:
            return (*place, name) if name in node.node.parameters else None
        setting = [
            (*place, index, name)
            for index, part in enumerate(items_of(parameters_node))
            if child(part, name) is not None
        ]
        return setting[-1] if setting else None

    def record_versions(self, node: NodeWiring) -> tuple[str, str] | None:
        """Return the package versions of a recorded interface and of here, if they differ."""
        entry = self.companion_files.interfaces.get(node.key)
        origin = entry.recorded_from if entry is not None else None
        if origin is None or not origin.version:
            return None
        installed = package_version(node.node.package)
        return (origin.version, installed) if installed not in {"", origin.version} else None

    @property
    def window(self) -> TimeWindow:
        """The part of the bag that is loaded."""
        window = self.spec.data_loader.window
        return TimeWindow(start_ns=window.start.ns, end_ns=window.end.ns if window.end else None)

    @cached_property
    def window_times(self) -> dict[str, TopicTimes] | None:
        """The times of loaded messages in the window, by names of the spec; None if not read."""
        from r2bspec.bags.recorded_times import merged_times, times_in_window

        read = [
            _times(bag.location.path, _stamp(bag.location.path))
            if bag.content is not None and bag.location is not None and bag.location.path
            else None
            for bag in self.recordings
        ]
        known = [times for times in read if times is not None]
        if self.bag is None or len(known) < len(read):
            return None
        times = merged_times(known)
        infos = {name: self.bag.find(name) for name in self.spec.data_loader.topics}
        loaded = {
            name: times[info.name]
            for name, info in infos.items()
            if info is not None and info.name in times
        }
        return times_in_window(loaded, self.bag, self.window)

    @cached_property
    def input_times(self) -> dict[str, TopicTimes]:
        """The times of stamped inputs that are loaded directly, if all of them are known."""
        return {name: each for name, each in self.first_times.items() if each.is_stamped}

    @cached_property
    def first_times(self) -> dict[str, TopicTimes]:
        """The times of stamped inputs that are loaded directly.

        Of a large bag there are the first stamps. They are corrected by what the spec says of the
        clock.
        """
        from r2bspec.bags.recorded_times import TopicTimes

        times = {}
        for name, played in self.spec.playback.played.items():
            source = self.wiring.topic(played.source)
            topic = direct_bag_topic(source, self.spec, self.wiring)
            found = (self.window_times or {}).get(topic)
            if found is not None and begins_with_header(played.format):
                ahead_ns = played.clock_ahead.ns
                # Stamps of 0 were never set.
                right_ns = [stamp_ns and stamp_ns - ahead_ns for stamp_ns in found.stamps_ns]
                times[name] = TopicTimes(found.recorded_ns, right_ns)
        return times

    @property
    def nodes(self) -> Iterator[tuple[str, NodeWiring]]:
        """Every node with the name of its phase."""
        for phase in self.wiring.phases:
            for node in phase.nodes:
                yield phase.phase, node

    @cached_property
    def requirements(self) -> tuple[LocatedRequirement, ...]:
        """Every requirement with its path."""
        return tuple(located_requirements(self.spec))

    def resolve(self, located: LocatedRequirement) -> KnownMetric:
        """Return a requirement with its metric.

        Raises:
            MetricError: the metric or the monitor does not exist.
        """
        metric = located.requirement.metric
        monitor, info = resolve(metric, self.spec.outputs, self.subjects)
        return KnownMetric(**msgspec.structs.asdict(located), monitor=monitor, info=info)

    @cached_property
    def known_metrics(self) -> list[KnownMetric]:
        """The requirements whose metric and monitor exist."""
        known = []
        for located in self.requirements:
            with suppress(MetricError):
                known.append(self.resolve(located))
        return known

    @cached_property
    def subjects(self) -> Subjects:
        """The subjects of metrics in the measured phase, other than monitors."""
        measured = self.wiring.measure
        return Subjects(
            processes=process_names(self.spec, self.wiring),
            nodes=tuple(node.key for node in measured.nodes),
            topics=tuple(topic.removeprefix("/") for topic in measured.topics),
            monitors=tuple(self.spec.outputs),
            namespace=self.wiring.namespace.strip("/"),
        )

    def relative_name(self, topic: str, namespace: str = "") -> str:
        """Return a topic name relative to a namespace, by default that of the spec."""
        inside = f"{(namespace or self.wiring.namespace).rstrip('/')}/"
        return topic.removeprefix(inside) if topic.startswith(inside) else topic


def cached_index(location: BagLocation) -> BagIndex:
    """Return the index of a located bag, read once until one of its files changes.

    Raises:
        DataError: the bag cannot be used.
    """
    if location.path is None:
        return index_location(location)
    return _index(location, _stamp(location.path))


@lru_cache(maxsize=32)
def _index(location: BagLocation, stamp: object) -> BagIndex:
    del stamp
    return index_location(location)


@lru_cache(maxsize=32)
def _times(path: FilePath, stamp: object) -> dict[str, TopicTimes] | None:
    """Return the times of the messages of a bag; None if they cannot be read."""
    from r2bspec.bags.recorded_times import times_of_bag

    del stamp
    return times_of_bag(path, cached_index(BagLocation(kind="recorded", path=path)))


def _stamp(bag: FilePath) -> tuple[object, ...]:
    """Return what changes with the files of a bag: their sizes, times and inodes."""
    try:
        files = sorted(bag.iterdir()) if bag.is_dir() else [bag]
        stats = [(file.name, file.stat()) for file in files]
    except OSError:
        return ()
    return tuple((name, stat.st_size, stat.st_mtime_ns, stat.st_ino) for name, stat in stats)


def clocks_ahead(times: Mapping[str, TopicTimes], slop_ns: int) -> dict[str, Duration]:
    """Return how far the clocks of inputs are ahead, by their names, if that is constant."""
    if len(times) < 2 or not all(each.recorded_ns for each in times.values()):
        return {}
    recorded_ns = [each.recorded_ns for each in times.values()]
    ahead_ns = clock_ahead(recorded_ns, [each.stamps_ns for each in times.values()], slop_ns)
    return {name: Duration(by_ns) for name, by_ns in zip(times, ahead_ns, strict=True)}


def messages_in_window(context: Context) -> dict[str, int]:
    """Return the messages in the window of each loaded topic, where their number is known."""
    bag, window = context.bag, context.window
    counts: dict[str, int] = {}
    if bag is None:
        return counts
    is_whole = not window.start_ns and (window.end_ns or bag.duration_ns + 1) > bag.duration_ns
    times = context.window_times or {}
    for name in context.spec.data_loader.topics:
        info = bag.find(name)
        if info is not None and is_whole:
            counts[name] = info.count
        elif info is not None and name in times:
            counts[name] = len(times[name].recorded_ns)
        elif info is not None and context.is_rendered:
            with suppress(DataError):
                counts[name] = describe(bag.name, {info.name}, window).message_count
    return counts
