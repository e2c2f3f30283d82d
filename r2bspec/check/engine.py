"""Running all rules over a spec, and leaving out what follows from something already said.

A rule sees only the whole spec, so one wrong word looks wrong to several of them: a misspelt
remapping leaves one topic that nobody publishes, another that nobody reads, and a monitor that
nothing reaches. Each finding therefore names the subjects that it is `suppressed_by`, and those
that it `suppresses`. Rules run in the order of their codes, causes before consequences; a finding
about a subject that an earlier rule has explained is left out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from r2bspec.check.check_context import Context
from r2bspec.check.finding_location import to_diagnostic
from r2bspec.check.rule_registry import all_rules
from r2bspec.diagnostics.diagnostic import Diagnostic
from r2bspec.diagnostics.waivers import apply_waivers
from r2bspec.language.case_findings import merge_case_findings

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec


def check(loaded: LoadedSpec, *, offline: bool = False) -> list[Diagnostic]:
    """Everything that is wrong with a spec, sorted by place.

    Where reading the document found errors, there is no spec to apply rules to, and those errors
    are all that is returned. What a comment waives (`r2bspec.diagnostics.waivers`) is left out.
    Nothing that the spec names is executed or imported.

    Args:
        loaded: what `load_spec` gave.
        offline: leave recorded data alone; rules that need it find nothing.
    """
    # Of a document with a matrix this is one case: a waiver may be meant for another.
    return _unwaived_findings([loaded], offline=offline, complete=loaded.matrix_case is None)


def check_cases(cases: Sequence[LoadedSpec], *, offline: bool = False) -> list[Diagnostic]:
    """Everything that is wrong with any case of one document, each finding once.

    Args:
        cases: every case, as `load_cases` gave them.
        offline: as for `check`.
    """
    return _unwaived_findings(cases, offline=offline, complete=True)


def _unwaived_findings(
    cases: Sequence[LoadedSpec], *, offline: bool, complete: bool
) -> list[Diagnostic]:
    found = merge_case_findings(cases, [_check_document(one, offline=offline) for one in cases])
    texts = {name: text for one in cases for name, text in one.texts.items()}
    complete = complete and not offline and all(one.spec is not None for one in cases)
    left = apply_waivers(found, texts, known=_slugs_by_code, complete=complete)
    return sorted(left, key=lambda each: each.sort_key)


def _check_document(loaded: LoadedSpec, *, offline: bool) -> list[Diagnostic]:
    found = list(loaded.diagnostics)
    if loaded.spec is not None:
        found += _apply_rules(Context(loaded, loaded.spec, offline=offline))
    return found


def _slugs_by_code() -> Mapping[str, str]:
    from r2bspec.check.pages import all_pages

    return {code: page.slug for code, page in all_pages().items()}


def _apply_rules(context: Context) -> list[Diagnostic]:
    found: list[Diagnostic] = []
    suppressed: set[str] = set()
    for rule in all_rules():
        # What a rule explains counts for the rules after it, not for its own other findings.
        kept = [each for each in rule.find(context) if not each.suppressed_by & suppressed]
        for finding in kept:
            suppressed |= finding.suppresses
            found.append(to_diagnostic(finding, rule.code, rule.severity, context.loaded))
    return found
