"""What the documentation points to is there: pages, sections, commands, and tests of promises."""

from __future__ import annotations

import ast
import re
import shlex
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGES = [
    *sorted((ROOT / "docs").rglob("*.md")),
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "tests" / "promises.md",
]

RELIABILITY = (ROOT / "tests" / "promises.md").read_text(encoding="utf-8")
THREATS = (ROOT / "docs" / "threat_model.md").read_text(encoding="utf-8")
PROMISED = sorted(set(re.findall(r"`(tests/\S+?\.py)::(\w+)`", RELIABILITY + THREATS)))


@cache
def anchors(page: Path) -> set[str]:
    """The anchors of the headings of a page, as GitHub makes them."""
    text = re.sub(
        r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
    )
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def leads_somewhere(page: Path, target: str) -> bool:
    name, _, anchor = target.partition("#")
    file = (page.parent / name).resolve() if name else page
    return file.exists() and (not anchor or anchor in anchors(file))


def test_every_link_leads_somewhere() -> None:
    links = [
        (page, target)
        for page in PAGES
        for target in re.findall(
            r"\]\(([^)\s]+)\)", re.sub(r"`[^`\n]*`", "", page.read_text(encoding="utf-8"))
        )
        if ":" not in target
    ]
    assert [
        f"{page}: {target}" for page, target in links if not leads_somewhere(page, target)
    ] == []


def test_every_page_is_reached_from_the_readme() -> None:
    pages, reached = [ROOT / "README.md"], set()
    while pages:
        page = pages.pop()
        reached.add(page)
        links = re.findall(r"\]\(([^):\s#]+\.md)", page.read_text(encoding="utf-8"))
        pages += {(page.parent / link).resolve() for link in links} - reached
    assert set(PAGES) <= reached


def test_every_command_that_prints_figures_exists() -> None:
    texts = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    for command in re.findall(r"Printed by `([^`]+)`", texts):
        words = [word for word in shlex.split(command) if not re.match(r"^[A-Z_]+=", word)]
        if words[0] == "make":
            assert f"\n{words[1]}:" in (ROOT / "Makefile").read_text(encoding="utf-8"), command
            continue
        assert words[0] == "python", command
        script = ROOT / words[1]
        options = [word.partition("=")[0] for word in words[2:] if word.startswith("--")]
        assert script.is_file(), command
        source = script.read_text(encoding="utf-8")
        assert [option for option in options if f'"{option}"' not in source] == [], command


def test_the_tests_of_all_promises_are_there() -> None:
    missing = [name for file, name in PROMISED if name not in functions(ROOT / file)]
    assert missing == []


@cache
def functions(file: Path) -> frozenset[str]:
    """The names of the functions of a module."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    return frozenset(node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef))


def test_every_promise_names_a_test() -> None:
    rows = [line for line in RELIABILITY.splitlines() if line.startswith("- ")]
    rows += [line for line in THREATS.splitlines() if line.startswith("| ")][2:]
    assert len(rows) > 100
    assert [row for row in rows if "`tests/" not in row] == []


def test_every_module_of_fault_tests_is_on_the_page() -> None:
    modules = {f"tests/fault/{file.name}" for file in (ROOT / "tests/fault").glob("test_*.py")}
    assert modules <= {file for file, _ in PROMISED}
