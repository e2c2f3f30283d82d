"""The files of this repository that the program writes; `make generated` writes them all anew.

They are the schemas for other programs, the tables of reference pages, and the templates for people
to read. Goldens are written anew by their own tests, with ``R2BSPEC_REWRITE=1`` in the environment.
"""

from __future__ import annotations

import re
from pathlib import Path

from key_tables import with_tables
from r2bspec.errors import ExitStatus
from r2bspec.judge.measure import metric_catalogue
from r2bspec.language import json_schema
from r2bspec.language.templates import SUFFIX, filled, templates
from r2bspec.plan import canonical_json
from r2bspec.report import data_formats

ROOT = Path(__file__).parents[2]
TEMPLATES = ROOT / "specs" / "templates"


def generated_files() -> dict[Path, str]:
    """Each generated file with what it should contain now."""
    schemas, docs = ROOT / "schemas", ROOT / "docs"
    files = {
        schemas / json_schema.FILE_NAME: json_schema.published_schema_text(),
        schemas / canonical_json.SCHEMA_FILE_NAME: canonical_json.plan_schema_text(),
        schemas / data_formats.RESULT_SCHEMA: data_formats.result_schema_text(),
        docs / "language.md": with_tables(_text(docs / "language.md")),
        docs / "metrics.md": metric_catalogue.markdown_page(),
        docs / "running.md": _with_exit_statuses(_text(docs / "running.md")),
    }
    schema = f"../../schemas/{json_schema.FILE_NAME}"
    for name, text in templates().items():
        files[TEMPLATES / f"{name}{SUFFIX}"] = filled(text, None, schema)
    return files


def stale_files() -> set[Path]:
    """Files that were generated once, and no longer are."""
    return set(TEMPLATES.glob(f"*{SUFFIX}")) - generated_files().keys()


def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def _with_exit_statuses(page: str) -> str:
    rows = "".join(f"| {status.value} | {status.meaning} |\n" for status in ExitStatus)
    table = f"<!-- exit statuses -->\n| status | meaning |\n| --- | --- |\n{rows}<!-- end -->"
    pattern = re.compile("<!-- exit statuses -->.*?<!-- end -->", re.DOTALL)
    return pattern.sub(lambda _: table, page)


if __name__ == "__main__":
    for stale in stale_files():
        stale.unlink()
    for file, content in generated_files().items():
        file.write_text(content, encoding="utf-8")
