"""The locations of requirements in their spec file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from r2bspec.diagnostics.diagnostic import Span
from r2bspec.judge.verdict import RequirementVerdict
from r2bspec.language.load_spec import LoadedSpec, load_spec
from r2bspec.language.located_tree import ListNode, ScalarNode, lookup
from r2bspec.safe_io.safe_file import is_regular


@dataclass(frozen=True)
class RequirementLocations:
    """The locations of a spec's requirements."""

    loaded: LoadedSpec

    def find(self, one: RequirementVerdict) -> Span:
        """The location of a requirement; else of its objective; else the whole file."""
        path = ("slos", one.objective, "require")
        listed = lookup(self.loaded.tree, path) if self.loaded.tree is not None else None
        for item in listed.items if isinstance(listed, ListNode) else ():
            if isinstance(item, ScalarNode) and item.text.strip() == one.text.strip():
                return item.span
        return self.loaded.span(("slos", one.objective), key=True)


def read_requirement_locations(spec_file: Path | None) -> RequirementLocations | None:
    """The locations in a file; None if it is unknown, missing, or not a spec."""
    if spec_file is None or not is_regular(spec_file) or spec_file.suffix == ".json":
        return None
    loaded = load_spec(spec_file)
    return RequirementLocations(loaded) if loaded.tree is not None else None
