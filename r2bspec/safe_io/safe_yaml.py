"""Loading YAML that is not a spec: parameter files, interface files, metadata of bags.

Before anything is built, a pass over the events of the parser, which uses no memory, compares the
document with limits. Aliases and merge keys (``<<``) count with everything that they insert.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import msgspec
import yaml

from r2bspec.safe_io.limits import MAX_YAML_DEPTH, MAX_YAML_EXPANDED_VALUES, MAX_YAML_VALUES

SCANNER_TOO_DEEP: Final = "exceeded maximum nesting depth"
"""What libyaml says from 0.2.6 on at 1,000 levels, some of them before their events."""


def too_deep(max_depth: int) -> str:
    """Return the message on a document with more levels than this."""
    return f"values are nested more than {max_depth} levels deep"


class RefusedYamlError(yaml.YAMLError):
    """A document that exceeds a limit.

    Attributes:
        line: counted from 1.
    """

    def __init__(self, reason: str, line: int) -> None:
        super().__init__(f"line {line}: {reason}")
        self.line = line


def load_values(
    text: str,
    *,
    max_depth: int = MAX_YAML_DEPTH,
    max_expanded: int = MAX_YAML_EXPANDED_VALUES,
    max_values: int = MAX_YAML_VALUES,
) -> Any:
    """Return the values of a document, as YAML 1.1 resolves them; no object is made from a tag.

    Raises:
        RefusedYamlError: it exceeds a limit.
        yaml.YAMLError: it is not YAML, or has other tags than those of plain values.
    """
    return _load(text, _LOADER, _Limits(max_depth, max_expanded, max_values))


def load_texts(text: str, *, max_values: int = MAX_YAML_VALUES) -> Any:
    """Return the document with every scalar as its written text: ``on`` and ``010`` stay.

    Raises:
        RefusedYamlError: it exceeds a limit.
        yaml.YAMLError: it is not YAML.
    """
    loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)
    return _load(text, loader, _Limits(max_values=max_values))


def check_document(text: str) -> None:
    """Check that a text is YAML within the limits, without building its values.

    Raises:
        RefusedYamlError: it is not.
    """
    try:
        _check(text, _LOADER, _Limits())
    except RefusedYamlError:
        raise
    except yaml.YAMLError as error:
        place = getattr(error, "problem_mark", None)
        line = 1 if place is None else place.line + 1
        raise RefusedYamlError("it is not YAML", line) from None


_LOADER: Final[Any] = getattr(yaml, "CSafeLoader", yaml.SafeLoader)


class _Limits(msgspec.Struct, frozen=True):
    max_depth: int = MAX_YAML_DEPTH
    max_expanded: int = MAX_YAML_EXPANDED_VALUES
    max_values: int = MAX_YAML_VALUES


def _load(text: str, loader: Any, limits: _Limits) -> Any:
    try:
        _check(text, loader, limits)
        return yaml.load(text, Loader=loader)  # noqa: S506 -- both build plain values only
    except yaml.YAMLError:
        raise
    except (ValueError, TypeError, RecursionError, OverflowError) as error:
        # Values such as the timestamp 2024-99-99 fail when they are converted.
        raise yaml.YAMLError(f"a value cannot be converted: {error}") from None


def _check(text: str, loader: Any, limits: _Limits) -> None:
    open_sizes: list[tuple[str | None, int]] = []
    anchors: dict[str, int] = {}
    values = expanded = 0
    event: Any
    for event in _events(text, loader, limits):
        line = event.start_mark.line + 1
        if isinstance(event, yaml.AliasEvent):
            size = _alias_size(event, anchors, open_sizes, line)
            expanded += size
            if expanded > limits.max_expanded:
                reason = f"aliases expand to more than {limits.max_expanded:,} values"
                raise RefusedYamlError(reason, line)
            _grow(open_sizes, size)
        elif isinstance(event, yaml.ScalarEvent):
            values += 1
            if event.anchor:
                anchors[event.anchor] = 1
            _grow(open_sizes, 1)
        elif isinstance(event, yaml.CollectionStartEvent):
            values += 1
            open_sizes.append((event.anchor, 1))
            if len(open_sizes) > limits.max_depth:
                raise _too_deep(limits, line)
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, size = open_sizes.pop()
            if anchor:
                anchors[anchor] = size
            _grow(open_sizes, size)
        if values > limits.max_values:
            raise RefusedYamlError(f"there are more than {limits.max_values:,} values", line)


def _events(text: str, loader: Any, limits: _Limits) -> Iterator[Any]:
    """Yield the events of the parser, whose own limit of nesting is refused as ours is."""
    try:
        yield from yaml.parse(text, Loader=loader)
    except yaml.scanner.ScannerError as error:
        if error.problem != SCANNER_TOO_DEEP or error.problem_mark is None:
            raise
        raise _too_deep(limits, error.problem_mark.line + 1) from None


def _too_deep(limits: _Limits, line: int) -> RefusedYamlError:
    return RefusedYamlError(too_deep(limits.max_depth), line)


def _alias_size(
    event: Any, anchors: dict[str, int], open_sizes: list[tuple[str | None, int]], line: int
) -> int:
    if any(anchor == event.anchor for anchor, _ in open_sizes):
        raise RefusedYamlError("an alias refers to a value that contains it", line)
    return anchors.get(event.anchor, 1)


def _grow(open_sizes: list[tuple[str | None, int]], size: int) -> None:
    if open_sizes:
        anchor, before = open_sizes[-1]
        open_sizes[-1] = (anchor, before + size)
