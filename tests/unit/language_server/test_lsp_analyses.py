"""How often the language server analyses what, and what it shows of it."""

from __future__ import annotations

import asyncio
import threading
from pathlib import Path

import pytest

from example_spec import example
from r2bspec.language_server.analysis import Analysis
from r2bspec.language_server.server import SpecLanguageServer


class Watched:
    """A server whose analyses are real, counted, and can be held up."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.server = SpecLanguageServer()
        self.analysed: list[tuple[str, str]] = []
        self.shown: list[tuple[str, str]] = []
        self.at_a_time = 0
        self.most_at_a_time = 0
        self.go_on = threading.Event()
        self.go_on.set()
        self.started = threading.Event()
        before = self.server.specs.analyse

        def analyse(path: Path) -> Analysis:
            self.at_a_time += 1
            self.most_at_a_time = max(self.at_a_time, self.most_at_a_time)
            found = before(path)
            self.analysed.append((path.name, found.text))
            self.started.set()
            assert self.go_on.wait(60)
            self.at_a_time -= 1
            return found

        def show(analysis: Analysis) -> None:
            self.shown.append((analysis.path.name, analysis.text))

        monkeypatch.setattr(self.server.specs, "analyse", analyse)
        monkeypatch.setattr(self.server, "_publish", show)

    async def idle(self) -> None:
        """Wait until nothing is left to analyse."""
        assert self.server._task is not None
        await self.server._task


@pytest.fixture
def watched(monkeypatch: pytest.MonkeyPatch) -> Watched:
    return Watched(monkeypatch)


def test_a_change_is_analysed_once_and_no_other_document(watched: Watched, tmp_path: Path) -> None:
    one, two = (tmp_path / f"{name}.r2b.yaml" for name in ("one", "two"))

    async def session() -> None:
        for each in (one, two):
            watched.server.change(each, example(each.name[:3]))
        await watched.idle()
        watched.analysed.clear()
        watched.shown.clear()
        watched.server.change(one, example("changed"))
        await watched.idle()

    asyncio.run(session())
    expected = [("one.r2b.yaml", example("changed"))]
    assert watched.analysed == watched.shown == expected


def test_a_parent_that_changes_concerns_those_that_extend_it(
    watched: Watched, tmp_path: Path
) -> None:
    child, other, parent = (tmp_path / name for name in ("c.r2b.yaml", "o.r2b.yaml", "p.r2b.yaml"))
    parent.write_text(example("p"))

    async def session() -> None:
        watched.server.change(child, "r2bspec: 1\nextends: p.r2b.yaml\nname: c\n")
        watched.server.change(other, example("o"))
        await watched.idle()
        watched.analysed.clear()
        watched.server.change(parent, example("changed"))
        await watched.idle()

    asyncio.run(session())
    assert sorted(name for name, _ in watched.analysed) == ["c.r2b.yaml", "p.r2b.yaml"]


def test_what_is_superseded_is_dropped(watched: Watched, tmp_path: Path) -> None:
    """However fast somebody types, one analysis runs at a time, and the last text is shown."""
    file = tmp_path / "one.r2b.yaml"
    texts = [example(f"version_{number}") for number in range(5)]

    async def session() -> None:
        watched.go_on.clear()
        watched.server.change(file, texts[0])
        await asyncio.to_thread(watched.started.wait, 60)
        for text in texts[1:]:
            watched.server.change(file, text)
            await asyncio.sleep(0)
        watched.go_on.set()
        await watched.idle()

    asyncio.run(session())
    assert [text for _, text in watched.analysed] == [texts[0], texts[-1]]
    assert [text for _, text in watched.shown] == [texts[-1]]
    assert watched.most_at_a_time == 1


def test_an_analysis_that_fails_does_not_end_the_others(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    watched = Watched(monkeypatch)
    logged: list[str] = []
    monkeypatch.setattr(watched.server, "log", lambda _, text: logged.append(text))
    analyse = watched.server.specs.analyse

    def fail_once(path: Path) -> Analysis:
        if path.name == "first.yaml":
            raise RuntimeError("a defect")
        return analyse(path)

    monkeypatch.setattr(watched.server.specs, "analyse", fail_once)

    async def session() -> None:
        watched.server.change(tmp_path / "first.yaml", example("any"))
        watched.server.change(tmp_path / "second.yaml", example("any"))
        await watched.idle()

    asyncio.run(session())
    assert watched.shown == [("second.yaml", example("any"))]
    assert len(logged) == 1
    assert "RuntimeError: a defect" in logged[0]
