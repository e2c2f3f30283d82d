"""Which runs a call of ``r2bspec run`` makes: files, cases, labels and scanned values."""

from __future__ import annotations

import fnmatch
import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from r2bspec.cli.run_options import ALL_CASES
from r2bspec.cli.spec_selection import SpecSelection
from r2bspec.errors import UsageError

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec


@dataclass(frozen=True)
class RunItem:
    """One run to be made.

    Attributes:
        suffix: added to the name of the benchmark, such as ``[rate=5 Hz]`` of a scan.
    """

    selection: SpecSelection
    suffix: str = ""


def is_file_list(paths: Sequence[str]) -> bool:
    """Whether each path is written as a file, not as a folder or a pattern."""
    return all(Path(each).is_file() for each in paths)


def run_items(
    selection: SpecSelection,
    files: Sequence[str],
    select: Sequence[str] = (),
    scan: Sequence[str] = (),
) -> list[RunItem]:
    """Every run, in the order of files, cases and scanned values.

    A matrix is run with all its cases, unless the selection names one.

    Args:
        selection: the options that apply to each file.
        files: specs and plans.
        select: ``LABEL=PATTERN``; a spec must match all.
        scan: ``NAME=VALUE,VALUE``; each combination of the values is a run.

    Raises:
        UsageError: nothing is left to run, or an option is malformed.
    """
    wanted = [_parse_label(each) for each in select]
    scans = [_parse_scan(each) for each in scan]
    items = [
        item
        for file in files
        for loaded, case in _cases(replace(selection, spec=Path(file)))
        if _matches(loaded, wanted)
        for item in _scanned(replace(selection, spec=Path(file), case=case), loaded, scans)
    ]
    if not items:
        raise UsageError(f"no spec has the labels {', '.join(select)}")
    return items


def selected_files(files: Sequence[str], select: Sequence[str]) -> list[str]:
    """The files of which a case has all labels of ``--select``.

    Raises:
        click.UsageError: a label is malformed.
    """
    labels = [_parse_label(text) for text in select]
    return [
        file
        for file in files
        if any(_matches(loaded, labels) for loaded, _ in _cases(SpecSelection(Path(file))))
    ]


def _cases(selection: SpecSelection) -> Iterator[tuple[LoadedSpec | None, str]]:
    """The cases of a file; a plan has one, and so has a document with errors."""
    if selection.spec.suffix == ".json":
        yield None, ""
        return
    wanted = "" if selection.case == ALL_CASES else selection.case
    found = replace(selection, case=wanted).load_cases()
    for loaded in found:
        # An unknown case stays: its error is that of the run.
        case = selection.case if selection.case != ALL_CASES else ""
        yield loaded, loaded.case or case


def _parse_label(text: str) -> tuple[str, str]:
    name, equals, pattern = text.partition("=")
    if not equals or not name:
        raise click.UsageError(f"--select takes LABEL=VALUE, not {text!r}")
    return name, pattern


def _matches(loaded: LoadedSpec | None, wanted: Sequence[tuple[str, str]]) -> bool:
    if not wanted:
        return True
    labels = loaded.spec.labels if loaded is not None and loaded.spec is not None else {}
    return all(
        name in labels and fnmatch.fnmatchcase(_text(labels[name]), pattern)
        for name, pattern in wanted
    )


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _parse_scan(text: str) -> tuple[str, tuple[str, ...]]:
    name, equals, rest = text.partition("=")
    values = tuple(each.strip() for each in rest.split(",") if each.strip())
    if not equals or not name or not values:
        raise click.UsageError(f"--scan takes NAME=VALUE,VALUE..., not {text!r}")
    return name, values


def _scanned(
    selection: SpecSelection,
    loaded: LoadedSpec | None,
    scans: Sequence[tuple[str, tuple[str, ...]]],
) -> Iterator[RunItem]:
    """The runs of one case: a variable of the spec is set, or else the key of that path."""
    spec = loaded.spec if loaded is not None else None
    declared = spec.variables if spec is not None else {}
    for values in itertools.product(*(each for _, each in scans)):
        sets, variables = list(selection.sets), dict(selection.variables or {})
        pairs = list(zip((name for name, _ in scans), values, strict=True))
        for name, value in pairs:
            if name in declared:
                variables[name] = value
            else:
                sets.append(f"{name}={value}")
        suffix = f"[{','.join(f'{name}={value}' for name, value in pairs)}]" if pairs else ""
        yield RunItem(replace(selection, sets=tuple(sets), variables=variables), suffix)
