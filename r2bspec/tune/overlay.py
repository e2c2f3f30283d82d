"""The spec of a winner: an overlay that extends the spec that was tuned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from r2bspec import api
from r2bspec.errors import UsageError
from r2bspec.language.selected_spec import SpecSelection
from r2bspec.language.variables import parse_path
from r2bspec.language.yaml_document import to_yaml
from r2bspec.plan.canonical_json import plan_hash
from r2bspec.plan.plan import Plan
from r2bspec.record.files import write_output


def check_overlay_path(file: Path, spec: Path) -> None:
    """Check that an overlay of a spec can be written.

    Raises:
        UsageError: it would be in another folder, or the file exists.
    """
    if file.resolve().parent != spec.resolve().parent:
        raise UsageError(
            f"{file} is not in the folder of {spec}, which it would extend",
            hint=f"Write {spec.parent / file.name}.",
        )
    if file.exists():
        raise UsageError(f"{file} exists already", hint="Name another file, or remove it.")


def write_overlay(
    file: Path, selection: SpecSelection, changes: Mapping[str, Any], plan: Plan, about: str
) -> None:
    """Write an overlay with the changes of a winner, and check that it is what was tuned.

    Args:
        file: to write, in the folder of the spec.
        selection: the selection of the spec.
        changes: values by path.
        plan: the plan of the spec with these changes.
        about: what is said in its first line.

    Raises:
        UsageError: the overlay is another spec; its file is removed.
    """
    write_output(file, f"# {about}\n{overlay_text(selection.spec.name, changes)}".encode())
    try:
        written = api.prepare(replace(selection, spec=file)).plan
    except api.InvalidSpecError as error:
        file.unlink()
        raise UsageError(f"no overlay can be written: {error}", hint=_by_hand(changes)) from error
    if plan_hash(written) != plan_hash(plan):
        file.unlink()
        raise UsageError(
            f"{selection.spec} has changed since the search began", hint=_by_hand(changes)
        )


def overlay_text(extended: str, changes: Mapping[str, Any]) -> str:
    """Return the YAML of a spec that extends a file, and sets values by path."""
    root: dict[str, Any] = {"extends": extended}
    for path, value in changes.items():
        *above, last = parse_path(path)
        node: dict[Any, Any] = root
        for step in above:
            node = node.setdefault(step, {})
        node[last] = value
    return to_yaml(root)


def _by_hand(changes: Mapping[str, Any]) -> str:
    values = ", ".join(f"{path}: {value!r}" for path, value in changes.items())
    return f"Set these values by hand: {values}."
