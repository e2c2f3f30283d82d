"""The documentation as a site: `make docs`. Its tree is the lists of links of docs/index.md."""

import re

from sphinx.application import Sphinx

project = "r2bspec"
extensions = ["myst_parser", "sphinxcontrib.mermaid"]
html_theme = "furo"
html_title = "r2bspec"
myst_heading_anchors = 4
myst_fence_as_directive = ["mermaid"]
highlight_language = "none"


def prepare(_: Sphinx, page: str, source: list[str]) -> None:
    """Name the pages that are in the repository alone, and make the lists of the index a tree."""
    source[0] = re.sub(r"\[([^]]+)\]\((?:\.\./)+([^)]+\.md)\)", r"\1 (`\2`)", source[0])
    if page == "index":
        lists = re.compile(r"^## (.+)\n\n((?:- \[.*\n)+)", re.MULTILINE)
        tree = "```{{toctree}}\n:hidden:\n:caption: {}\n\n{}\n```\n".format
        source[0] += "\n".join(
            tree(title, "\n".join(re.findall(r"\]\((\S+)\.md\)", links)))
            for title, links in lists.findall(source[0])
        )


def setup(app: Sphinx) -> None:
    """Connect what is done to pages."""
    app.connect("source-read", prepare)
