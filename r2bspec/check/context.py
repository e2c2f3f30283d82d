"""What the rules of one check look at; everything is worked out when it is first asked for."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TYPE_CHECKING

from r2bspec.check.requirements import Placed, placed_requirements
from r2bspec.diagnostics.model import Path
from r2bspec.plan.compile import bag_types
from r2bspec.plan.processes import process_names
from r2bspec.spec.model import Spec
from r2bspec.spec.tree import lookup
from r2bspec.wiring.build import build_wiring
from r2bspec.wiring.model import NodeWiring, Wiring

if TYPE_CHECKING:
    from r2bspec.data.errors import DataError
    from r2bspec.data.model import BagIndex, BagLocation
    from r2bspec.spec.load import Loaded


class Context:
    """A spec and what can be known around it without executing anything.

    Attributes:
        loaded: the document as it was read.
        spec: its typed value.
        offline: whether to leave recorded data alone.
    """

    def __init__(self, loaded: Loaded, spec: Spec, *, offline: bool = False) -> None:
        self.loaded = loaded
        self.spec = spec
        self.offline = offline

    @cached_property
    def wiring(self) -> Wiring:
        """Who writes and who reads which topic."""
        return build_wiring(self.spec, bag_types=bag_types(self.spec, self.bag))

    @property
    def bag(self) -> BagIndex | None:
        """What is known of the bag; None offline, or if it cannot be used."""
        return self._data[1]

    @property
    def bag_location(self) -> BagLocation | None:
        """Where the bag is; None offline, or if it cannot be found."""
        return self._data[0]

    @property
    def bag_error(self) -> DataError | None:
        """Why the bag cannot be used, if it was looked at and cannot."""
        return self._data[2]

    @cached_property
    def _data(self) -> tuple[BagLocation | None, BagIndex | None, DataError | None]:
        if self.offline:
            return None, None, None
        from r2bspec.data import DataError, index_location, locate_bag

        source = self.spec.data_loader.bag
        # A path that is one word is still a path if the spec says so.
        path = source.path if "/" in source.path or not source.path else f"./{source.path}"
        location = None
        try:
            location = locate_bag(path or source.dataset, self.loaded.base_dir)
            return location, index_location(location), None
        except DataError as error:
            return location, None, error

    @property
    def bag_path(self) -> Path:
        """The place of the bag's name in the document: its own value, or below it."""
        path: Path = ("data_loader", "bag")
        tree = self.loaded.tree
        for key in ("dataset", "path"):
            if tree is not None and lookup(tree, (*path, key)) is not None:
                return (*path, key)
        return path

    @property
    def nodes(self) -> Iterator[tuple[str, NodeWiring]]:
        """Every node with the name of its phase."""
        for phase in self.wiring.phases:
            for node in phase.nodes:
                yield phase.phase, node

    @cached_property
    def requirements(self) -> tuple[Placed, ...]:
        """Every requirement with its place."""
        return tuple(placed_requirements(self.spec))

    @cached_property
    def processes(self) -> tuple[str, ...]:
        """The names of the processes that run while measuring."""
        return process_names(self.spec, self.wiring)

    def shown(self, topic: str, namespace: str = "") -> str:
        """A full topic name as one would write it in a namespace, the spec's by default."""
        inside = f"{(namespace or self.wiring.namespace).rstrip('/')}/"
        return topic.removeprefix(inside) if topic.startswith(inside) else topic
