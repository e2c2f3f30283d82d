"""The definition of a rule."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from r2bspec.check.check_context import Context
from r2bspec.check.finding import Findings, SeverityName
from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


class Rule(msgspec.Struct, frozen=True, kw_only=True):
    """One rule: title, reason, examples, and the function that finds violations.

    Attributes:
        code: such as ``R2B204``.
        title: what is wrong, in a few words, without a full stop.
        severity: of its findings, unless a finding has its own.
        why: one or two sentences: the consequences of the error.
        failing: a complete spec with a finding of the rule; empty if it would need other files.
        passing: the corrected spec, without findings.
        find: yields the findings; it may use everything in the context, and executes nothing.
        early: whether its findings suppress findings of rules with lower codes.
    """

    code: str
    title: str
    severity: SeverityName
    why: str
    find: Callable[[Context], Findings]
    failing: str = ""
    passing: str = ""
    early: bool = False

    @property
    def slug(self) -> str:
        """The name of the rule's module with dashes, such as ``variable-unused``."""
        return self.find.__module__.rpartition(".")[2].replace("_", "-")

    @property
    def page(self) -> Page:
        """The page of the rule for `r2bspec explain`."""
        return Page(
            slug=self.slug,
            code=self.code,
            title=self.title,
            severity=Severity(self.severity),
            why=self.why,
            failing=self.failing,
            passing=self.passing,
        )
