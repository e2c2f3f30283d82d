"""``r2bspec docs``: the documentation that is installed with r2bspec."""

from __future__ import annotations

from pathlib import Path

import click

from r2bspec.errors import UsageError
from r2bspec.exit_status import ExitStatus
from r2bspec.report.output import echo

_PACKAGE = Path(__file__).parents[1]


@click.command("docs")
@click.argument("page", required=False)
@click.option("--path", "show_path", is_flag=True, help="Print the path instead of the text.")
def command(page: str | None, show_path: bool) -> int:
    """List the pages of the documentation, or print PAGE, such as running or proofs/verdicts.

    Pages are Markdown.
    """
    folder = docs_folder()
    files = (*sorted(folder.glob("*.md")), *sorted(folder.glob("*/*.md")))
    pages = {file.relative_to(folder).with_suffix("").as_posix(): file for file in files}
    if page is None:
        if show_path:
            echo(str(folder))
            return ExitStatus.OK
        width = max(map(len, pages), default=0)
        for name, file in pages.items():
            echo(f"{name:<{width}}  {_title(file)}")
        return ExitStatus.OK
    name = page.removesuffix(".md")
    if name not in pages:
        from r2bspec.diagnostics import did_you_mean

        close = did_you_mean(name, pages)
        hint = f"did you mean {close!r}? " if close else ""
        raise UsageError(f"there is no page {page!r}", hint=f"{hint}'r2bspec docs' lists the pages")
    if show_path:
        echo(str(pages[name]))
    else:
        echo(pages[name].read_text(encoding="utf-8"), nl=False)
    return ExitStatus.OK


def docs_folder() -> Path:
    """Where the pages are: in the installed package, or in the repository.

    Raises:
        UsageError: this installation has none.
    """
    for folder in (_PACKAGE / "docs", _PACKAGE.parent / "docs"):
        if (folder / "language.md").is_file():
            return folder
    raise UsageError("this installation of r2bspec has no documentation")


def _title(file: Path) -> str:
    """The first heading of a page."""
    lines = file.read_text(encoding="utf-8").splitlines()
    return next((line.lstrip("# ") for line in lines if line.startswith("# ")), "")
