"""What a shell proposes for the values of options and arguments.

A proposal never fails: if something cannot be read, nothing is proposed.
"""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

Complete = Callable[[click.Context, click.Parameter, str], "list[CompletionItem]"]


def _proposals(values: Callable[[click.Context], Iterable[str]]) -> Complete:
    """Return a function for ``shell_complete`` that proposes values by their beginning."""

    @functools.wraps(values)
    def complete(
        ctx: click.Context, _param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        try:
            from click.shell_completion import CompletionItem

            return [CompletionItem(value) for value in values(ctx) if value.startswith(incomplete)]
        except Exception:  # a traceback in the middle of a command line helps no user
            return []

    return complete


def _spec_of(_ctx: click.Context) -> Path:
    """Return the spec that the command line names.

    From the words that the shell passes on: an option without a value, which is what is completed,
    ends the parsing of the command line, so that click does not know its arguments.
    """
    import shlex

    words = shlex.split(os.environ.get("COMP_WORDS", ""))
    return next(Path(word) for word in words[2:] if Path(word).is_file())


@_proposals
def complete_case(ctx: click.Context) -> Iterable[str]:
    """Propose the cases of the spec, and ``all``."""
    from r2bspec.language.load_spec import load_cases

    return [*(case.case for case in load_cases(_spec_of(ctx)) if case.case), "all"]


@_proposals
def complete_variable(ctx: click.Context) -> Iterable[str]:
    """Propose the variables that the spec declares, as ``NAME=``."""
    from r2bspec.language.load_spec import load_cases

    spec = load_cases(_spec_of(ctx))[0].spec
    return [f"{name}=" for name in (spec.variables if spec is not None else ())]


@_proposals
def complete_template(_ctx: click.Context) -> Iterable[str]:
    """Propose the templates of ``init``."""
    from r2bspec.language.templates import templates

    return list(templates())


@_proposals
def complete_topic(_ctx: click.Context) -> Iterable[str]:
    """Propose the topics of ``docs``: pages, codes and their slugs, metrics."""
    from r2bspec.cli.docs import doc_pages
    from r2bspec.diagnostics.code_pages import all_pages
    from r2bspec.judge.measure.metric_catalogue import names

    pages = all_pages()
    return [*doc_pages(), *pages, *(page.slug for page in pages.values()), *names()]


@_proposals
def complete_dataset(_ctx: click.Context) -> Iterable[str]:
    """Propose the datasets."""
    from r2bspec.datasets.catalogue import known_datasets

    return known_datasets()


@_proposals
def complete_report(_ctx: click.Context) -> Iterable[str]:
    """Propose the formats of reports, as ``FORMAT=``."""
    from r2bspec.report.format_registry import FORMATS

    return [f"{name}=" for name in FORMATS]
