"""What a rule is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from r2bspec.check.check_context import Context
from r2bspec.check.finding import Finding
from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One rule: what it says, why, an example of each outcome, and how it finds out.

    Attributes:
        code: such as ``R2B204``.
        title: what is wrong, in a few words, without a full stop.
        severity: how bad its findings are, unless one says otherwise.
        why: one or two sentences: what would go wrong if it were let through.
        failing: a whole spec in which the rule finds something; empty where that takes a file
            that no example can hold.
        passing: the same, put right: nothing is found in it.
        find: yields the findings; it may look at everything in the context, and executes nothing.
        early: whether its findings explain what rules of lower codes find.
    """

    code: str
    title: str
    severity: Severity
    why: str
    find: Callable[[Context], Iterator[Finding]]
    failing: str = ""
    passing: str = ""
    early: bool = False

    @property
    def slug(self) -> str:
        """The name of the rule's module with dashes, such as ``variable-unused``."""
        return self.find.__module__.rpartition(".")[2].replace("_", "-")

    @property
    def page(self) -> Page:
        """What `r2bspec explain` says of the rule."""
        return Page(
            slug=self.slug,
            code=self.code,
            title=self.title,
            severity=self.severity,
            why=self.why,
            failing=self.failing,
            passing=self.passing,
        )
