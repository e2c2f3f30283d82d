"""The pages of `r2bspec explain` for the codes of this package, one module for each family."""

from __future__ import annotations

from r2bspec.diagnostics.code_pages import Page
from r2bspec.language.pages.reuse_codes import REUSE_PAGES
from r2bspec.language.pages.schema_codes import SCHEMA_PAGES
from r2bspec.language.pages.variable_codes import VARIABLE_PAGES
from r2bspec.language.pages.yaml_codes import YAML_PAGES

PAGES: dict[str, Page] = {
    page.code: page for page in (*YAML_PAGES, *SCHEMA_PAGES, *VARIABLE_PAGES, *REUSE_PAGES)
}
"""The page of every code from R2B001 to R2B199; examples show the relevant part of a spec."""
