"""The pages of the codes, which `docs`, reports and editors show for a diagnostic.

Each code has a file in the folder ``pages`` of this package, Markdown with front matter::

    ---
    code: R2B204
    slug: remapping-unmatched
    title: remapping matches no topic of the node
    severity: error
    ---

    One or two sentences on the consequences.

    ## Failing example

    ```yaml
    ...
    ```

    ## Passing example

    ```yaml
    ...
    ```

The examples are complete specs where a rule of the graph is shown, and the relevant part of a spec
otherwise. A page has both, or none if the problem needs other files.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import msgspec

from r2bspec.diagnostics.diagnostic import Severity

FAMILIES = {
    "0": "The file and its YAML",
    "1": "The language",
    "2": "Names and types in the graph",
    "3": "Recorded data",
    "4": "Playback and monitors",
    "5": "Rates and requirements",
    "6": "Files, this machine, and the run",
    "7": "Scripts and launch files",
    "8": "Tuning",
}
"""The family of a code, by its first digit."""

_FOLDER = Path(__file__).with_name("pages")
_CODE = re.compile(r"R2B\d{3}")
_PAGE = re.compile(r"---\n(?P<front>.*?)\n---\n\n(?P<why>.*?)\n(?P<examples>\n## .*)?", re.DOTALL)
_EXAMPLE = re.compile(r"^## (\w+) example\n\n```yaml\n(.*?^)```$", re.DOTALL | re.MULTILINE)


class Page(msgspec.Struct, frozen=True):
    """The explanation of a diagnostic code.

    Attributes:
        code: such as ``R2B204``.
        slug: the name of the code in words, such as ``unknown-key``: unique, in kebab case.
        title: the problem in a few words, without a full stop.
        severity: the default severity of its findings.
        why: one or two sentences on the consequences of the problem, or the rule behind it.
        failing: YAML with the problem; a whole spec or the relevant part. May be empty.
        passing: the same without the problem. May be empty.
    """

    code: str
    slug: str
    title: str
    severity: Severity
    why: str
    failing: str
    passing: str


def all_pages() -> dict[str, Page]:
    """Return every page by its code, in the order of the codes."""
    codes = sorted(file.stem for file in _FOLDER.glob("R2B*.md"))
    return {code: page for code in codes if (page := find_page(code)) is not None}


def page_file(code: str) -> Path:
    """Return the file of the page of a code; editors link to it."""
    return _FOLDER / f"{code}.md"


@cache
def find_page(code: str) -> Page | None:
    """Return the page of a code; None for a code without a page."""
    if not _CODE.fullmatch(code):
        return None
    try:
        text = page_file(code).read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    return parse_page(text)


def parse_page(text: str) -> Page:
    """Return a page from its file.

    Raises:
        ValueError: it does not have the form of a page.
    """
    parts = _PAGE.fullmatch(text)
    if parts is None:
        raise ValueError("a page is front matter, a paragraph, and examples")
    front = dict(line.split(": ", 1) for line in parts["front"].splitlines())
    examples = dict(_EXAMPLE.findall(parts["examples"] or ""))
    return Page(
        code=front["code"],
        slug=front["slug"],
        title=front["title"],
        severity=Severity(front["severity"]),
        why=" ".join(parts["why"].split("\n")),
        failing=examples.get("Failing", ""),
        passing=examples.get("Passing", ""),
    )
