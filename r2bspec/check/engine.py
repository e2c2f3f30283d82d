"""Runs all rules over a spec, and drops findings that follow from earlier ones.

Every rule checks the whole spec, so several rules find the same error: a misspelt remapping leaves
one topic without a publisher, another without a subscription, and a monitor without messages. Each
finding therefore names the subjects that it is `suppressed_by`, and those that it `suppresses`.
Rules run in the order of their codes, causes before consequences; a finding about a subject that an
earlier rule suppresses is dropped.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Mapping, Sequence
from functools import cache
from importlib import import_module
from itertools import chain, islice
from operator import attrgetter
from typing import TYPE_CHECKING

from r2bspec.check import rules
from r2bspec.check.check_context import Context, DocumentFiles
from r2bspec.check.rule import Rule, to_diagnostic
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.diagnostics.diagnostic import Diagnostic, Severity
from r2bspec.diagnostics.waivers import apply_waivers
from r2bspec.language.document import MAX_PROBLEMS
from r2bspec.language.matrix import merge_case_findings

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec

_STOPPED = "R2B005"


@cache
def all_rules() -> tuple[Rule, ...]:
    """Return every rule: early rules first, then by code, so that causes come first."""
    modules = pkgutil.iter_modules(rules.__path__, f"{rules.__name__}.")
    values = (value for module in modules for value in vars(import_module(module.name)).values())
    unsorted = (value for value in values if isinstance(value, Rule))
    return tuple(sorted(unsorted, key=lambda rule: (not rule.early, rule.code)))


def check(
    loaded: LoadedSpec, *, offline: bool = False, context: Context | None = None
) -> list[Diagnostic]:
    """Return all findings about a spec, sorted by place.

    A document with errors has no spec, so only these errors are returned. Findings that a comment
    waives (`r2bspec.diagnostics.waivers`) are left out. Nothing that the spec names is executed or
    imported.

    Args:
        loaded: from `load_spec`.
        offline: skip recorded data; rules that need it find nothing.
        context: from `context_of`, for a caller that goes on using what the rules have worked out.
    """
    context = context or context_of(loaded, offline=offline)
    # A document with a matrix has other cases, to which a waiver may apply.
    return _unwaived_findings([loaded], [context], complete=loaded.matrix_case is None)


def check_cases(
    cases: Sequence[LoadedSpec],
    *,
    offline: bool = False,
    contexts: Sequence[Context | None] | None = None,
) -> list[Diagnostic]:
    """Return all findings about the cases of one document, each finding once.

    Args:
        cases: every case, from `load_cases`.
        offline: as for `check`.
        contexts: from `context_of`, as for `check`: one for each case, None where it has no spec.
    """
    if contexts is None:
        files = DocumentFiles(cases[0].base_dir) if cases else None
        contexts = [context_of(case, offline=offline, files=files) for case in cases]
    return _unwaived_findings(cases, contexts, complete=True)


def context_of(
    loaded: LoadedSpec, *, offline: bool = False, files: DocumentFiles | None = None
) -> Context | None:
    """Return the context of a spec; None if the document has errors.

    Args:
        loaded: from `load_spec`.
        offline: as for `check`.
        files: shared with other cases of the document.
    """
    if loaded.spec is None:
        return None
    return Context(loaded, loaded.spec, offline=offline, files=files)


def _unwaived_findings(
    cases: Sequence[LoadedSpec], contexts: Sequence[Context | None], *, complete: bool
) -> list[Diagnostic]:
    findings = [
        [*case.diagnostics, *(_apply_rules(context) if context is not None else ())]
        for case, context in zip(cases, contexts, strict=True)
    ]
    texts = {name: text for case in cases for name, text in case.texts.items()}
    complete = complete and all(context and not context.offline for context in contexts)
    merged = merge_case_findings(cases, findings)
    return _shown(apply_waivers(merged, texts, known=_slugs_by_code, complete=complete))


def _slugs_by_code() -> Mapping[str, str]:
    return {code: page.slug for code, page in all_pages().items()}


def _apply_rules(context: Context) -> list[Diagnostic]:
    diagnostics: list[Diagnostic] = []
    suppressed: set[str] = set()
    for rule in all_rules():
        findings = rule.find(context)
        first = next(findings, None)
        if first is None:
            continue
        # A rule suppresses findings of later rules, but not its own.
        unsuppressed = (
            finding
            for finding in chain((first,), findings)
            if suppressed.isdisjoint(finding.suppressed_by)
        )
        kept = list(islice(unsuppressed, MAX_PROBLEMS + 1))
        placed = [
            to_diagnostic(finding, rule.code, rule.page.severity, context.loaded)
            for finding in kept
        ]
        for finding in kept:
            suppressed |= finding.suppresses
        if len(placed) > MAX_PROBLEMS:
            placed[MAX_PROBLEMS:] = [_rule_stopped(rule, placed)]
        diagnostics += placed
    return diagnostics


def _rule_stopped(rule: Rule, placed: Sequence[Diagnostic]) -> Diagnostic:
    """Says that a rule was stopped. What it would have found then may include an error."""
    may_be_error = any(
        severity == "error"
        for severity in (rule.page.severity, *(finding.severity for finding in placed))
    )
    return Diagnostic(
        _STOPPED,
        Severity.ERROR if may_be_error else Severity.WARNING,
        f"more than {MAX_PROBLEMS:,} findings of {rule.code}; the rest was not searched for",
        placed[-1].span,
        help="correct these first; they usually have one cause",
    )


def _shown(findings: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Return the findings sorted by place; of too many, the most severe, and how many there are."""
    ordered = sorted(findings, key=_by_place)
    # That a rule was stopped is shown in any case: nothing else says that there may be more.
    others = [finding for finding in ordered if finding.code != _STOPPED]
    if len(others) <= MAX_PROBLEMS:
        return ordered
    stopped = [finding for finding in ordered if finding.code == _STOPPED]
    severities = list(Severity)
    by_severity = sorted(others, key=lambda finding: severities.index(finding.severity))
    kept = sorted([*by_severity[:MAX_PROBLEMS], *stopped], key=_by_place)
    message = f"{len(others):,} findings; only {MAX_PROBLEMS:,} are shown, errors first"
    return [*kept, Diagnostic(_STOPPED, Severity.INFO, message, kept[-1].span)]


_by_place = attrgetter("sort_key")
