"""What `r2bspec explain` says of the codes of this package, a module for each family."""

from __future__ import annotations

from r2bspec.diagnostics.pages import Page
from r2bspec.spec.pages.reuse import REUSE_PAGES
from r2bspec.spec.pages.schema import SCHEMA_PAGES
from r2bspec.spec.pages.variables import VARIABLE_PAGES
from r2bspec.spec.pages.yaml import YAML_PAGES

PAGES: dict[str, Page] = {
    page.code: page for page in (*YAML_PAGES, *SCHEMA_PAGES, *VARIABLE_PAGES, *REUSE_PAGES)
}
"""Every code from R2B001 to R2B199 with its page; examples show the part that matters."""
