"""The definition of a rule."""

from __future__ import annotations

from collections.abc import Callable

import msgspec

from r2bspec.check.check_context import Context
from r2bspec.check.finding import Findings
from r2bspec.diagnostics.code_pages import Page, find_page


class Rule(msgspec.Struct, frozen=True, kw_only=True):
    """One rule: its code, and the function that finds violations.

    What else is said of it is on the page of its code: title, severity, reason and examples.

    Attributes:
        code: such as ``R2B204``.
        find: yields the findings; it may use everything in the context, and executes nothing.
        early: whether its findings suppress findings of rules with lower codes.
    """

    code: str
    find: Callable[[Context], Findings]
    early: bool = False

    @property
    def page(self) -> Page:
        """The page of the rule, with the severity of findings that have none of their own.

        Raises:
            LookupError: the code has no page.
        """
        page = find_page(self.code)
        if page is None:
            raise LookupError(f"{self.code} has no page")
        return page
