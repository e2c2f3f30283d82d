"""Runs all rules over a spec, and drops findings that follow from earlier ones.

Every rule checks the whole spec, so several rules find the same error: a misspelt remapping leaves
one topic without a publisher, another without a subscription, and a monitor without messages. Each
finding therefore names the subjects that it is `suppressed_by`, and those that it `suppresses`.
Rules run in the order of their codes, causes before consequences; a finding about a subject that an
earlier rule suppresses is dropped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, islice
from typing import TYPE_CHECKING

from r2bspec.check.check_context import Context
from r2bspec.check.document_files import DocumentFiles
from r2bspec.check.finding_location import to_diagnostic
from r2bspec.check.rule import Rule
from r2bspec.check.rule_registry import all_rules
from r2bspec.diagnostics.code_pages import all_pages
from r2bspec.diagnostics.diagnostic import Diagnostic, Severity
from r2bspec.diagnostics.waivers import apply_waivers
from r2bspec.language.document import MAX_PROBLEMS
from r2bspec.language.matrix import merge_case_findings

if TYPE_CHECKING:
    from r2bspec.language.load_spec import LoadedSpec

_STOPPED = "R2B005"


def check(loaded: LoadedSpec, *, offline: bool = False) -> list[Diagnostic]:
    """All findings about a spec, sorted by place.

    A document with errors has no spec, so only these errors are returned. Findings that a comment
    waives (`r2bspec.diagnostics.waivers`) are left out. Nothing that the spec names is executed or
    imported.

    Args:
        loaded: from `load_spec`.
        offline: skip recorded data; rules that need it find nothing.
    """
    return check_in_context(loaded, context_of(loaded, offline=offline))


def check_in_context(loaded: LoadedSpec, context: Context | None) -> list[Diagnostic]:
    """The same as `check`, for a caller that goes on using what the rules have worked out.

    Args:
        loaded: from `load_spec`.
        context: from `context_of`; None where there is no spec.
    """
    # A document with a matrix has other cases, to which a waiver may apply.
    return _unwaived_findings([loaded], [context], complete=loaded.matrix_case is None)


def context_of(
    loaded: LoadedSpec, *, offline: bool = False, files: DocumentFiles | None = None
) -> Context | None:
    """The context of a spec; None where the document has errors.

    Args:
        loaded: from `load_spec`.
        offline: as for `check`.
        files: shared with other cases of the document.
    """
    if loaded.spec is None:
        return None
    return Context(loaded, loaded.spec, offline=offline, files=files)


def check_cases(cases: Sequence[LoadedSpec], *, offline: bool = False) -> list[Diagnostic]:
    """All findings about the cases of one document, each finding once.

    Args:
        cases: every case, from `load_cases`.
        offline: as for `check`.
    """
    files = DocumentFiles(cases[0].base_dir) if cases else None
    contexts = [context_of(one, offline=offline, files=files) for one in cases]
    return check_cases_in_contexts(cases, contexts)


def check_cases_in_contexts(
    cases: Sequence[LoadedSpec], contexts: Sequence[Context | None]
) -> list[Diagnostic]:
    """The same as `check_cases`, for a caller that goes on using what the rules have worked out.

    Args:
        cases: every case, from `load_cases`.
        contexts: from `context_of`, one for each case; None where there is no spec.
    """
    return _unwaived_findings(cases, contexts, complete=True)


def _unwaived_findings(
    cases: Sequence[LoadedSpec], contexts: Sequence[Context | None], *, complete: bool
) -> list[Diagnostic]:
    findings = [_check_document(one, context) for one, context in zip(cases, contexts, strict=True)]
    found = merge_case_findings(cases, findings)
    texts = {name: text for one in cases for name, text in one.texts.items()}
    complete = complete and all(each is not None and not each.offline for each in contexts)
    left = apply_waivers(found, texts, known=_slugs_by_code, complete=complete)
    return _shown(left)


def _check_document(loaded: LoadedSpec, context: Context | None) -> list[Diagnostic]:
    return [*loaded.diagnostics, *(_apply_rules(context) if context is not None else ())]


def _slugs_by_code() -> Mapping[str, str]:
    return {code: page.slug for code, page in all_pages().items()}


def _apply_rules(context: Context) -> list[Diagnostic]:
    found: list[Diagnostic] = []
    suppressed: set[str] = set()
    for rule in all_rules():
        findings = rule.find(context)
        first = next(findings, None)
        if first is None:
            continue
        # A rule suppresses findings of later rules, but not its own.
        unsuppressed = (
            each for each in chain((first,), findings) if suppressed.isdisjoint(each.suppressed_by)
        )
        kept = list(islice(unsuppressed, MAX_PROBLEMS + 1))
        made = [to_diagnostic(each, rule.code, rule.page.severity, context.loaded) for each in kept]
        for finding in kept:
            suppressed |= finding.suppresses
        if len(made) > MAX_PROBLEMS:
            made[MAX_PROBLEMS:] = [_rule_stopped(rule, made)]
        found += made
    return found


def _rule_stopped(rule: Rule, made: Sequence[Diagnostic]) -> Diagnostic:
    """Says that a rule was stopped. What it would have found then may include an error."""
    may_be_error = any(
        severity == "error"
        for severity in (rule.page.severity, *(finding.severity for finding in made))
    )
    return Diagnostic(
        _STOPPED,
        Severity.ERROR if may_be_error else Severity.WARNING,
        f"more than {MAX_PROBLEMS:,} findings of {rule.code}; the rest was not searched for",
        made[-1].span,
        help="correct these first; they usually have one cause",
    )


def _shown(found: Sequence[Diagnostic]) -> list[Diagnostic]:
    """The findings sorted by place; of too many, the most severe, and how many there are."""
    # That a rule was stopped is shown in any case: nothing else says that there may be more.
    stopped = [one for one in found if one.code == _STOPPED]
    ordered = sorted((one for one in found if one.code != _STOPPED), key=lambda one: one.sort_key)
    if len(ordered) <= MAX_PROBLEMS:
        return sorted(found, key=lambda one: one.sort_key)
    severities = list(Severity)
    by_severity = sorted(ordered, key=lambda each: severities.index(each.severity))
    kept = sorted([*by_severity[:MAX_PROBLEMS], *stopped], key=lambda one: one.sort_key)
    message = f"{len(ordered):,} findings; only {MAX_PROBLEMS:,} are shown, errors first"
    return [*kept, Diagnostic(_STOPPED, Severity.INFO, message, kept[-1].span)]
