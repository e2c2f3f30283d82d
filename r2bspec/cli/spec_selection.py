"""A spec as selected on the command line, prepared, with its findings printed."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from r2bspec.language.selected_spec import SpecSelection as SpecSelection

if TYPE_CHECKING:
    from r2bspec.api import PreparedBenchmark
    from r2bspec.compare.base_reference import BaseReference


def prepare_and_report(
    selection: SpecSelection, *, smoke: bool = False, require_slos: bool = False
) -> PreparedBenchmark:
    """Prepare a spec, or a smoke run of it; findings are printed to standard error.

    Args:
        selection: the spec.
        smoke: prepare a smoke run.
        require_slos: refuse a spec that nothing can fail.

    Raises:
        InvalidSpecError: it has errors.
        MissingObjectivesError: nothing can fail it, and `require_slos` is given.
        PlanError: the file is not a valid plan.
        DataError: the bag does not exist or is not readable.
    """
    from r2bspec import api
    from r2bspec.report.findings_text import print_findings as show

    try:
        prepared = api.prepare(selection, smoke=smoke)
    except api.InvalidSpecError as error:
        show(error.diagnostics, error.loaded.texts)
        raise
    if prepared.loaded is not None:
        show(prepared.diagnostics, prepared.loaded.texts)
    if require_slos:
        _require_objectives(prepared, selection)
    return prepared


def _require_objectives(prepared: PreparedBenchmark, selection: SpecSelection) -> None:
    from r2bspec.compare.gate_strength import MissingObjectivesError, require_objectives
    from r2bspec.report.findings_text import print_findings as show

    loaded = prepared.loaded
    try:
        require_objectives(prepared.plan, loaded.file if loaded else str(selection.spec))
    except MissingObjectivesError as error:
        show([error.diagnostic], loaded.texts if loaded else {})
        error.remainder = ""
        raise


def base_selection(head: SpecSelection, reference: BaseReference) -> SpecSelection:
    """The base of a reference.

    With the head's own spec it has the head's options of the command line, changed by the
    reference. Another spec has only the options of the reference.
    """
    if reference.spec is not None:
        return replace(
            head,
            spec=reference.spec,
            sets=reference.sets,
            variables=dict(reference.variables),
            case="",
        )
    return replace(
        head,
        sets=(*head.sets, *reference.sets),
        variables={**(head.variables or {}), **reference.variables},
    )
