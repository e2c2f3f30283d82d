"""R2B040 to R2B043: waivers in comments."""

from __future__ import annotations

from r2bspec.check.example_spec import example
from r2bspec.diagnostics.code_pages import Page
from r2bspec.diagnostics.diagnostic import Severity

_TWICE = "{rates: [30 Hz, 30 Hz]}"
_WAIVED = "  # r2bspec: ignore[R2B512] shows that both take as long"


def _page(slug: str, code: str, title: str, why: str, failing: str, passing: str) -> Page:
    return Page(slug, code, title, Severity.WARNING, why, failing, passing)


def _benchmark(text: str) -> str:
    return example(benchmark=text)


WAIVER_PAGES = (
    _page(
        "waiver-without-reason",
        "R2B040",
        "a waiver without a code or a reason",
        "A waiver tells the next reader why something that looks wrong is meant. Without a reason "
        "it only hides a finding, so it waives nothing.",
        _benchmark(f"{_TWICE} # r2bspec: ignore[R2B512]"),
        _benchmark(_TWICE + _WAIVED),
    ),
    _page(
        "waiver-of-unknown-code",
        "R2B041",
        "a waiver of a code that does not exist",
        "It waives nothing, and whoever wrote it believes that it does.",
        _benchmark(f"{_TWICE} # r2bspec: ignore[R2B572] shows that both take as long"),
        _benchmark(_TWICE + _WAIVED),
    ),
    _page(
        "unused-waiver",
        "R2B042",
        "a waiver with nothing to waive",
        "What it spoke of has been put right or has moved; left behind, it would hide the next "
        "mistake of that kind.",
        _benchmark(f"{{rates: [30 Hz]}} {_WAIVED}"),
        _benchmark(_TWICE + _WAIVED),
    ),
    _page(
        "code-not-waivable",
        "R2B043",
        "a waiver of what keeps the document from being read",
        "Errors of the YAML and of the language leave no spec that could be run, however good the "
        "reason.",
        "",
        "",
    ),
)
