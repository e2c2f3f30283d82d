"""A plan with everything else that a run needs."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from r2bspec.diagnostics import Diagnostic
    from r2bspec.language.load_spec import LoadedSpec
    from r2bspec.plan.plan import Plan


SPEC_BESIDE_PLAN = ".spec.yaml"
"""In place of the suffix of a plan file: the file with its resolved spec, which fleets send."""


@dataclass(frozen=True)
class PreparedBenchmark:
    """A plan that is ready to run.

    Attributes:
        base_dir: the folder to which paths in the plan are relative.
        spec_text: the resolved spec; empty for a plan that has none beside it.
        diagnostics: warnings; errors have been raised.
        loaded: the document from which the plan was compiled, if any.
    """

    plan: Plan
    base_dir: Path
    spec_text: str
    diagnostics: tuple[Diagnostic, ...] = ()
    loaded: LoadedSpec | None = None
