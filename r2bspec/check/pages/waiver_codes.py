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
        "waiver without a code or a reason",
        "A waiver says which finding is intended, and why. Without a code and a reason it has no "
        "effect.",
        _benchmark(f"{_TWICE} # r2bspec: ignore[R2B512]"),
        _benchmark(_TWICE + _WAIVED),
    ),
    _page(
        "waiver-of-unknown-code",
        "R2B041",
        "waiver of an unknown code",
        "The code does not exist, so the waiver has no effect.",
        _benchmark(f"{_TWICE} # r2bspec: ignore[R2B572] shows that both take as long"),
        _benchmark(_TWICE + _WAIVED),
    ),
    _page(
        "unused-waiver",
        "R2B042",
        "unused waiver",
        "The finding was fixed or has moved. If the waiver stayed, it would hide the next finding "
        "of this code.",
        _benchmark(f"{{rates: [30 Hz]}} {_WAIVED}"),
        _benchmark(_TWICE + _WAIVED),
    ),
    _page(
        "code-not-waivable",
        "R2B043",
        "waiver of an error that cannot be waived",
        "Errors of the YAML or the language leave no spec to run.",
        "",
        "",
    ),
)
