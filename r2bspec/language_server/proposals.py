"""One thing that can be written at the cursor, and where such things come from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from lsprotocol import types

from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.cursor_context import CursorContext


@dataclass(frozen=True, slots=True)
class Proposal:
    """One thing that can be written.

    Attributes:
        label: what is shown, and inserted if `insert` is empty.
        insert: what is inserted instead of the label; the lines after the first one are relative
            to the indentation of the first.
        is_snippet: whether `insert` has placeholders.
        order: lower ones are shown first.
    """

    label: str
    detail: str = ""
    documentation: str = ""
    insert: str = ""
    kind: types.CompletionItemKind = types.CompletionItemKind.Value
    is_snippet: bool = False
    order: int = 500


ProposalSource = Callable[[Analysis, CursorContext], Iterator[Proposal]]
"""What can be written at the path of a context."""
