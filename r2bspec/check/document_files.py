"""What the cases of one document read: each file once, however many cases name it."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from r2bspec.check.bag_index_cache import cached_index
from r2bspec.safe_io.looked_up_files import note_folder
from r2bspec.wiring.companion_files import CompanionFiles, CompanionReader

if TYPE_CHECKING:
    from r2bspec.bags.recording import BagIndex, BagLocation, DataError
    from r2bspec.language.spec import Spec


class DocumentFiles:
    """The companion files and bags of a document.

    Args:
        base_dir: the folder of the document.
    """

    def __init__(self, base_dir: Path) -> None:
        self._base_dir = base_dir
        self._bags: dict[str, tuple[BagLocation | None, BagIndex | None, DataError | None]] = {}

    @cached_property
    def _companions(self) -> CompanionReader:
        return CompanionReader(self._base_dir)

    def companion_files(self, spec: Spec) -> CompanionFiles:
        """The companion files of one case."""
        return self._companions.read(spec)

    def bag(self, bag: str) -> tuple[BagLocation | None, BagIndex | None, DataError | None]:
        """The location of a bag, and its index or its error."""
        if bag not in self._bags:
            self._bags[bag] = self._located(bag)
        return self._bags[bag]

    def _located(self, bag: str) -> tuple[BagLocation | None, BagIndex | None, DataError | None]:
        from r2bspec.bags.recording import DataError
        from r2bspec.datasets.catalogue import locate

        location = None
        try:
            location = locate(bag, self._base_dir)
            if location.path is not None:
                note_folder(location.path)
            return location, cached_index(location), None
        except DataError as error:
            return location, None, error
