"""Changes that weaken their own gate, each in another way: none of them comes through.

Nothing is played: what a gate refuses, it refuses before.
"""

from __future__ import annotations

import os
import re
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from gated_repositories import BASE, SPEC, edit, gate, gated_repository, sides_of, write_words
from git_repositories import commit, git
from nightly import sampled
from r2bspec import api
from r2bspec.compare import merge_gate
from r2bspec.compare.base_environment import check_tools
from r2bspec.compare.gate_rules import FREE, GATED
from r2bspec.compare.merge_gate import RunCheck
from r2bspec.errors import R2bspecError
from r2bspec.language.spec import Spec
from r2bspec.plan.canonical_json import canonical_json

Change = Callable[[Path], None]
WEAK = ("latency.p50 < 1 ms", "latency.p50 < 5 s")


@pytest.fixture(scope="session")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return gated_repository(tmp_path_factory.mktemp("gate") / "robot")


@pytest.fixture
def top(original: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "robot"
    shutil.copytree(original, folder, symlinks=True)
    monkeypatch.chdir(folder)
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(temporary))
    return folder


def test_the_same_spec_is_compared_with_itself(top: Path) -> None:
    (sides,) = gate()
    assert sides.base is not None
    assert "Same spec as main@" in sides.sentences[-1]


def test_another_node_is_what_a_gate_is_for(top: Path) -> None:
    edit(top / "src/echo.py", ("10)", "20)"))
    (sides,) = gate()
    assert sides.base is not None
    assert sides.base.plan.objectives == sides.head.plan.objectives
    assert sides.base.identity != sides.head.identity


def spec_of(top: Path) -> Path:
    return top / SPEC


def weakened(top: Path, name: str) -> None:
    """Put a weak version of the spec beside it."""
    text = spec_of(top).read_text()
    assert WEAK[0] in text
    (spec_of(top).parent / name).write_text(text.replace(*WEAK))


def linked_spec(top: Path) -> None:
    (top / "weak").mkdir()
    text = spec_of(top).read_text().replace(*WEAK).replace("../src", "../src")
    (top / "weak/words.yaml").write_text(text)
    spec_of(top).unlink()
    spec_of(top).symlink_to("../weak/words.yaml")


def linked_folder(top: Path) -> None:
    shutil.copytree(top / "bench", top / "other")
    edit(top / "other/words.r2b.yaml", WEAK)
    shutil.rmtree(top / "bench")
    (top / "bench").symlink_to("other")


def folder_in_its_place(top: Path) -> None:
    text = spec_of(top).read_text().replace(*WEAK)
    spec_of(top).unlink()
    spec_of(top).mkdir()
    (spec_of(top) / "words.r2b.yaml").write_text(
        text.replace("./drive", "../drive")
        .replace("../src", "../../src")
        .replace("common", "../common")
    )


def renamed_and_weakened(top: Path) -> None:
    weakened(top, "soft.r2b.yaml")
    spec_of(top).unlink()


def renamed_with_its_name(top: Path) -> None:
    renamed_and_weakened(top)
    edit(top / "bench/soft.r2b.yaml", ("name: words", "name: soft"))


def renamed_by_case(top: Path) -> None:
    weakened(top, "Words.r2b.yaml")
    spec_of(top).unlink()


def hidden(top: Path) -> None:
    (top / "bench").rename(top / ".bench")
    (top / "bench").mkdir()
    weak = (top / ".bench/words.r2b.yaml").read_text().replace(*WEAK)
    (top / "bench/new.r2b.yaml").write_text(weak.replace("./drive", "../.bench/drive"))


def pipe_in_its_place(top: Path) -> None:
    spec_of(top).unlink()
    os.mkfifo(spec_of(top))


def unreadable(top: Path) -> None:
    spec_of(top).unlink()
    spec_of(top).symlink_to(spec_of(top).name)


def nested_repository(top: Path) -> None:
    edit(spec_of(top), WEAK)
    git(top / "bench", "init", "--quiet", "--initial-branch=main")
    git(top / "bench", "add", "--all")
    git(top / "bench", "commit", "--quiet", "--message", "its own base")


def submodule(top: Path) -> None:
    own = top.parent / "own"
    shutil.copytree(top / "bench", own)
    edit(own / "words.r2b.yaml", WEAK)
    commit(own)
    shutil.rmtree(top / "bench")
    git(top, "rm", "-r", "--quiet", "--cached", "bench")
    git(top, "submodule", "--quiet", "add", str(own), "bench")


SPEC_GONE: dict[Change, str] = {
    linked_spec: f"spec {SPEC} (a link",
    linked_folder: "bench is a link",
    folder_in_its_place: f"spec {SPEC} (no regular file",
    renamed_and_weakened: f"spec {SPEC} (gone)",
    renamed_with_its_name: f"spec {SPEC} (gone)",
    renamed_by_case: f"spec {SPEC} (gone)",
    hidden: f"spec {SPEC} (gone)",
    pipe_in_its_place: f"spec {SPEC} (no regular file",
    unreadable: f"spec {SPEC} (a link",
    nested_repository: "bench is a repository of its own",
    submodule: "bench is a repository of its own",
}


@pytest.mark.parametrize("change", SPEC_GONE, ids=lambda change: change.__name__)
def test_a_spec_is_the_file_that_the_base_has(top: Path, change: Change) -> None:
    change(top)
    for path in ("bench", SPEC, "."):
        with pytest.raises(R2bspecError) as refused:
            gate(path)
        assert refused.value.exit_code == 2
        if path != ".":
            assert SPEC_GONE[change] in str(refused.value)


@pytest.mark.parametrize("path", ["bench/new.r2b.yaml", "elsewhere"])
def test_where_a_spec_is_gone_another_is_not_new(top: Path, path: str) -> None:
    """Even if only the new one is named, as by a shell that looks for files."""
    (top / "elsewhere").mkdir()
    place = top / ("elsewhere/new.r2b.yaml" if path == "elsewhere" else path)
    place.write_text(spec_of(top).read_text().replace("name: words", "name: new").replace(*WEAK))
    if path == "elsewhere":
        edit(place, ("./drive", "../bench/drive"), ("common/", "../bench/common/"))
    assert gate(path)[0].base is None, "nothing is gone"
    spec_of(top).unlink()
    with pytest.raises(R2bspecError, match="the gate differs"):
        gate(path)
    (sides,) = gate(path, allow=[f"spec {SPEC}"])
    assert sides.base is None
    assert any("New spec: main@" in text for text in sides.sentences)


def test_a_renamed_spec_that_may_be_gone_is_compared_with_what_it_was(top: Path) -> None:
    spec_of(top).rename(top / "bench/moved.r2b.yaml")
    (sides,) = gate(allow=[f"spec {SPEC}"])
    assert sides.base is not None
    assert any("Renamed: the spec is bench/words.r2b.yaml" in text for text in sides.sentences)
    edit(top / "bench/moved.r2b.yaml", WEAK)
    with pytest.raises(R2bspecError, match="objective fast"):
        gate(allow=[f"spec {SPEC}"])


def in_spec(*changes: tuple[str, str]) -> Change:
    return lambda top: edit(spec_of(top), *changes)


def in_file(name: str, *changes: tuple[str, str]) -> Change:
    return lambda top: edit(top / name, *changes)


def other_parameters(top: Path) -> None:
    edit(spec_of(top), ("../src/cut.yaml", "{length: 1}"))


def helper(top: Path) -> None:
    """Weaken by a file that the preprocessor imports, and the base does not."""
    (top / "src/small.py").write_text("LENGTH = 1\n")
    edit(top / "src/cut.py", ("from rclpy", "import small\nfrom rclpy"))


CHANGED: dict[str, tuple[Change, str]] = {
    "a wider limit": (in_spec(WEAK), "objective fast"),
    "an objective that only warns": (
        in_spec(
            (
                "at: 30 Hz, require: [latency.p50 <=",
                "level: warn, at: 30 Hz, require: [latency.p50 <=",
            )
        ),
        "objective same",
    ),
    "an objective that is gone": (
        in_spec(("  same: {at: 30 Hz, require: [latency.p50 <= 105 % of baseline]}\n", "")),
        "objective same",
    ),
    "an objective of another name": (in_spec(("  fast:", "  swift:")), "objective fast"),
    "an absolute limit for a relative one": (
        in_spec(("105 % of baseline", "5 s")),
        "objective same",
    ),
    "a file that it extends": (
        in_file("bench/common/limits.yaml", ("10 %", "90 %")),
        "objective kept",
    ),
    "a file that it no longer extends": (
        in_spec(("extends: common/limits.yaml\n", "")),
        "objective kept",
    ),
    "a variable that switches an objective off": (
        in_spec(("strict: 1}\ndata", "strict: 0}\ndata")),
        "objective fast",
    ),
    "a condition": (in_spec(("when: {strict: 1}", "when: {strict: 2}")), "objective fast"),
    "a lower confidence": (
        in_spec(("[latency.p50 < 1 ms],", "[latency.p50 < 1 ms], confidence: 60 %,")),
        "objective fast",
    ),
    "another rate": (in_spec(("rates: [30 Hz]", "rates: [30 Hz, 1 Hz]")), "benchmark.rates"),
    "fewer iterations": (in_spec(("iterations: 10", "iterations: 9")), "benchmark.iterations"),
    "inconclusive passes": (
        in_spec(("duration: 1 s}", "duration: 1 s, gate: {inconclusive: pass}}")),
        "benchmark.gate.inconclusive",
    ),
    "no confirmation": (
        in_spec(("duration: 1 s}", "duration: 1 s, gate: {time_budget: 1 s}}")),
        "benchmark.gate.time_budget",
    ),
    "a monitor of another topic": (in_spec(("{topic: out,", "{topic: /r2b/out,")), "monitor out"),
    "a monitor that matches otherwise": (
        in_spec(("match: order", "match: order, qos: {depth: 3}")),
        "monitor out",
    ),
    "another topic of the recording": (
        in_spec(("timestamp: none", "timestamp: none, qos: {depth: 1}")),
        "input words",
    ),
    "a part of the recording": (
        in_spec(("./drive,", "./drive, window: {end: 100 ms},")),
        "data_loader.window.end",
    ),
    "a higher limit of memory": (in_spec(("200 MiB", "20 GiB")), "memory_limit echo"),
    "no limit of memory": (in_spec(("      memory_limit: 200 MiB\n", "")), "memory_limit echo"),
    "another transport": (in_spec(("monitors:", "transport: udp\nmonitors:")), "transport.kind"),
    "a waiver": (
        in_spec(("monitors:", "# r2bspec: ignore[R2B500] not so bad\nmonitors:")),
        "waiver R2B500",
    ),
    "a parameter of a preprocessor": (other_parameters, "preprocessors"),
    "no preprocessor": (in_spec(("from: loaded", "from: recorded")), "input words"),
    "a file of a preprocessor": (
        in_file("src/cut.py", ("publish(words)", "publish(String())")),
        "input",
    ),
    "a parameter file of a preprocessor": (in_file("src/cut.yaml", ("100", "1")), "input"),
    "a file that a preprocessor imports": (helper, "input"),
    "smaller messages": (lambda top: write_words(top / "bench/drive", "."), "input"),
    "fewer messages behind a link": (lambda top: link_bag(top), "input"),
}


def link_bag(top: Path) -> None:
    write_words(top / "small", ".")
    shutil.rmtree(top / "bench/drive")
    (top / "bench/drive").symlink_to("../small")


@pytest.mark.parametrize("name", sampled(CHANGED, 3))
def test_what_a_verdict_depends_on_is_as_in_the_base(top: Path, name: str) -> None:
    change, allowed = CHANGED[name]
    change(top)
    with pytest.raises(R2bspecError) as refused:
        gate()
    assert (refused.value.code, refused.value.exit_code) == ("R2B692", 2)
    assert str(refused.value).endswith(f": {allowed}")
    (sides,) = gate(allow=[allowed])
    assert sides.base is not None, "it is compared all the same"
    assert any(f"Allowed: {allowed}" in text for text in sides.sentences)
    assert not any("Same spec" in text for text in sides.sentences)


STRICTER: dict[str, Change] = {
    "a tighter limit": in_spec(("latency.p50 < 1 ms", "latency.p50 < 500 us")),
    "another requirement": in_spec(
        ("[latency.p50 < 1 ms]", "[latency.p50 < 1 ms, drop_rate < 5 %]")
    ),
    "another objective": in_spec(
        ("slos:\n", "slos:\n  more: {at: 30 Hz, require: [received > 1]}\n")
    ),
    "another monitor": in_spec(
        (
            "monitors: {",
            "monitors: {again: {topic: out, format: std_msgs/msg/String, match: order}, ",
        )
    ),
    "a lower limit of memory": in_spec(("200 MiB", "100 MiB")),
    "words": in_spec(("name: words", "name: words\ntitle: Words\nlabels: {a: b}")),
    "the graph": in_spec(("{threads: $(var threads)}", "{threads: 4}")),
    "another storage of the recording": lambda top: write_words(
        top / "bench/drive", storage="mcap"
    ),
}


@pytest.mark.parametrize("name", STRICTER)
def test_what_is_stricter_needs_no_allowance(top: Path, name: str) -> None:
    STRICTER[name](top)
    (sides,) = gate()
    assert sides.base is not None


def matrix(axes: str) -> Change:
    return in_spec(("variables:", f"matrix: {axes}\nvariables:"))


def test_a_base_without_a_matrix_is_the_base_of_each_case(top: Path) -> None:
    matrix("{axes: {threads: [1, 2]}}")(top)
    assert [sides.base is not None for sides in gate()] == [True, True]
    edit(spec_of(top), WEAK)
    with pytest.raises(R2bspecError, match="objective fast"):
        gate()


def test_a_case_of_the_base_is_in_the_head(top: Path) -> None:
    matrix("{axes: {threads: [1, 2]}}")(top)
    commit(top)
    git(top, "branch", "--force", "main", "HEAD")
    assert len(gate()) == 2
    edit(spec_of(top), ("[1, 2]}}", "[1, 2]}, exclude: [{threads: 2}]}"))
    with pytest.raises(R2bspecError, match=r"case words\[threads=2\]"):
        gate()
    edit(spec_of(top), ("[1, 2]}, exclude: [{threads: 2}]}", "[1, 2, 3]}}"))
    assert [sides.base is not None for sides in gate()] == [True, True, False]
    edit(spec_of(top), ("matrix: {axes: {threads: [1, 2, 3]}}\n", ""))
    with pytest.raises(R2bspecError, match="case words"):
        gate()


def test_a_case_of_the_base_has_its_values(top: Path) -> None:
    matrix("{cases: {small: {threads: 1}, large: {threads: 2}}}")(top)
    commit(top)
    git(top, "branch", "--force", "main", "HEAD")
    edit(spec_of(top), ("large: {threads: 2}", "large: {threads: 1}"))
    with pytest.raises(R2bspecError, match=r"case words\[large\]"):
        gate()
    assert len(gate(allow=["case words[large]"])) == 2


def test_a_spec_that_nothing_can_fail_is_refused(top: Path) -> None:
    new = top / "bench/new.r2b.yaml"
    text = spec_of(top).read_text().replace("name: words\nextends: common/limits.yaml", "name: new")
    new.write_text(text[: text.index("slos:")])
    with pytest.raises(R2bspecError) as refused:
        gate()
    assert refused.value.code == "R2B693"


def test_the_beginning_of_a_commit_is_no_name_of_a_branch(top: Path) -> None:
    commit(top, {"note": "more"})
    name = git(top, "rev-parse", "main")[:8]
    assert gate(base=name)
    git(top, "update-ref", f"refs/tags/v1-3-g{name}", "HEAD")
    git(top, "update-ref", f"refs/heads/{name}", "HEAD")
    for text in (name, f"v1-3-g{name}"):
        with pytest.raises(R2bspecError, match="is ambiguous"):
            gate(base=text)


def test_the_main_branch_of_a_remote_is_no_name_of_a_tag(top: Path) -> None:
    git(top, "update-ref", "refs/remotes/origin/HEAD", "main")
    assert gate(base="origin")
    commit(top, {"note": "more"})
    git(top, "update-ref", "refs/tags/origin", "HEAD")
    with pytest.raises(R2bspecError, match="is ambiguous"):
        gate(base="origin")


@pytest.mark.parametrize("kind", ["tag", "branch", "refs"])
def test_a_name_that_two_references_have_is_refused(top: Path, kind: str) -> None:
    weak = git(top, "commit-tree", "HEAD^{tree}", "-p", "HEAD", "-m", "weak")
    git(top, "update-ref", "refs/remotes/origin/main", "main")
    assert gate(base="origin/main")
    place = {"tag": "refs/tags/", "branch": "refs/heads/", "refs": "refs/"}[kind]
    git(top, "update-ref", f"{place}origin/main", weak)
    with pytest.raises(R2bspecError, match="is ambiguous") as refused:
        gate(base="origin/main")
    assert "refs/remotes/origin/main is" in str(refused.value)
    assert f"{place}origin/main is {weak[:12]}" in str(refused.value)
    assert gate(base="refs/remotes/origin/main")


def weak_commit(top: Path) -> str:
    """Make a commit of a weak spec that the branch does not have."""
    edit(spec_of(top), WEAK)
    tree = git(top, "stash", "create")
    git(top, "checkout", "--quiet", "--", ".")
    return git(top, "commit-tree", f"{tree}^{{tree}}", "-m", "weak")


def test_replaced_objects_and_grafts_count_for_nothing(top: Path) -> None:
    weak = weak_commit(top)
    git(top, "replace", "main", weak)
    (top / ".git/info").mkdir(exist_ok=True)
    commit(top, {"note": "more"})
    (top / ".git/info/grafts").write_text(f"{git(top, 'rev-parse', 'HEAD')}\n")
    edit(spec_of(top), WEAK)
    with pytest.raises(R2bspecError, match="objective fast"):
        gate()


ATTRIBUTES = (
    "bench/** export-ignore",
    "bench/*.yaml export-subst",
    "bench/*.yaml ident",
    "*.yaml text eol=crlf",
    "*.yaml filter=evil",
    "*.yaml working-tree-encoding=UTF-16",
)


@pytest.mark.parametrize("attribute", ATTRIBUTES)
def test_no_attribute_changes_the_base(top: Path, attribute: str) -> None:
    git(top, "config", "filter.evil.smudge", "touch ran; sed 's/< 1 ms/< 5 s/'")
    (top / ".git/info").mkdir(exist_ok=True)
    (top / ".git/info/attributes").write_text(f"{attribute}\n")
    (top / ".gitattributes").write_text(f"{attribute}\n")
    git(top, "add", ".gitattributes")
    git(top, "commit", "--quiet", "--message", "attributes")
    git(top, "branch", "--force", "main", "HEAD")
    (sides,) = gate()
    assert sides.base is not None
    edit(spec_of(top), WEAK)
    with pytest.raises(R2bspecError, match="objective fast"):
        gate()
    assert not (top / "ran").exists()


def test_a_head_that_lacks_commits_is_compared_with_where_it_left(top: Path) -> None:
    git(top, "checkout", "--quiet", "main")
    edit(top / "src/echo.py", ("10)", "20)"))
    commit(top)
    git(top, "checkout", "--quiet", "change")
    (sides,) = gate()
    assert sides.base is not None
    said = next(text for text in sides.sentences if "lacks" in text)
    assert said.startswith("HEAD lacks 1 commit of refs/heads/main: its base is ")
    edit(spec_of(top), WEAK)
    with pytest.raises(R2bspecError, match="objective fast"):
        gate()


def later_spec(top: Path) -> str:
    text = spec_of(top).read_text().replace("name: words", "name: later")
    (top / "bench/later.r2b.yaml").write_text(text)
    return "spec bench/later.r2b.yaml"


def tighter_spec(top: Path) -> str:
    edit(spec_of(top), ("latency.p50 < 1 ms", "latency.p50 < 500 us"))
    return f"spec {SPEC}"


def tighter_file(top: Path) -> str:
    edit(top / "bench/common/limits.yaml", ("10 %", "5 %"))
    return f"spec {SPEC}"


@pytest.mark.parametrize("change", [later_spec, tighter_spec, tighter_file])
def test_a_head_that_left_early_is_not_asked_for_less(
    top: Path, change: Callable[[Path], str]
) -> None:
    git(top, "checkout", "--quiet", "main")
    name = change(top)
    commit(top)
    git(top, "checkout", "--quiet", "change")
    with pytest.raises(R2bspecError, match=re.escape(name)) as refused:
        gate()
    assert refused.value.hint.startswith("Merge main@")
    (sides,) = gate(allow=[name])
    assert sides.base is not None
    git(top, "checkout", "main", "--", "bench")
    assert all("Allowed" not in text for sides in gate() for text in sides.sentences)
    git(top, "reset", "--quiet", "--hard")
    git(top, "merge", "--quiet", "main")
    assert all(sides.base is not None for sides in gate())


def test_histories_without_a_common_commit_are_compared_with_the_base_itself(top: Path) -> None:
    git(top, "checkout", "--quiet", "--orphan", "orphan")
    commit(top)
    (sides,) = gate()
    assert any("has no common commit" in text for text in sides.sentences)
    edit(spec_of(top), WEAK)
    with pytest.raises(R2bspecError, match="objective fast"):
        gate()


def test_the_repository_is_that_of_the_working_folder(
    top: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for path in (str(tmp_path), "..", str(tmp_path / "robot/../x.r2b.yaml")):
        with pytest.raises(R2bspecError) as refused:
            gate(path)
        assert refused.value.code == "R2B694"
    monkeypatch.chdir(top / "bench")
    assert len(gate("words.r2b.yaml")) == 1
    assert len(gate("..")) == 1
    monkeypatch.chdir(tmp_path)
    with pytest.raises(R2bspecError, match="no git repository"):
        gate("robot/bench")


def test_a_new_link_is_not_gated_and_that_is_said(top: Path) -> None:
    (top / "bench/more.r2b.yaml").symlink_to("words.r2b.yaml")
    (top / "bench/loop.r2b.yaml").symlink_to("loop.r2b.yaml")
    (sides,) = gate()
    assert sides.base is not None


def test_a_recording_that_git_does_not_have_is_played_on_both_sides(top: Path) -> None:
    git(top, "rm", "-r", "--quiet", "--cached", "bench/drive")
    commit(top, {".gitignore": "bench/drive\nruns/\n"})
    git(top, "branch", "--force", "main", "HEAD")
    assert gate()[0].base is not None
    write_words(top / "bench/drive", ".")
    assert gate()[0].base is not None, "it is the pipeline's"
    git(top, "add", "--force", "bench/drive")
    with pytest.raises(R2bspecError, match="input"):
        gate()


def ignored_recording(top: Path) -> None:
    """Keep the recording out of git, in a folder of its own, as if it had been downloaded."""
    (top / "bench/recordings").mkdir()
    shutil.move(top / "bench/drive", top / "bench/recordings/drive")
    edit(spec_of(top), ("./drive", "./recordings/drive"))
    commit(top, {".gitignore": "bench/recordings/\nruns/\n"})
    git(top, "branch", "--force", "main", "HEAD")


def test_a_link_puts_no_other_recording_in_the_place_of_one_that_git_does_not_have(
    top: Path,
) -> None:
    ignored_recording(top)
    assert gate()[0].base is not None
    shutil.rmtree(top / "bench/recordings")
    write_words(top / "small/drive", ".")
    (top / "bench/recordings").symlink_to("../small")
    (top / ".gitignore").write_text("runs/\n")
    commit(top)
    with pytest.raises(R2bspecError, match="input"):
        gate()
    (sides,) = gate(allow=["input"])
    assert sides.base is not None


def test_a_folder_that_the_pipeline_has_linked_is_its_own(top: Path, tmp_path: Path) -> None:
    ignored_recording(top)
    shutil.move(top / "bench/recordings", tmp_path / "cache")
    (top / "bench/recordings").symlink_to(tmp_path / "cache")
    assert gate()[0].base is not None


def test_a_recording_in_a_submodule_is_that_of_the_base(top: Path, tmp_path: Path) -> None:
    write_words(tmp_path / "recordings/drive")
    commit(tmp_path / "recordings")
    git(top, "submodule", "--quiet", "add", str(tmp_path / "recordings"), "bench/recordings")
    edit(spec_of(top), ("./drive", "./recordings/drive"))
    commit(top)
    git(top, "branch", "--force", "main", "HEAD")
    assert gate()[0].base is not None
    write_words(top / "bench/recordings/drive", ".")
    commit(top / "bench/recordings")
    commit(top)
    with pytest.raises(R2bspecError, match="input"):
        gate()


def test_what_is_allowed_as_input_is_played_on_both_sides(top: Path) -> None:
    write_words(top / "bench/drive", ".")
    edit(top / "src/cut.py", ("publish(words)", "publish(String())"))
    with api.open_gate(BASE, ["input"]) as opened:
        (sides,) = sides_of(opened)
        assert sides.base is not None
        assert (sides.base.base_dir / "drive").resolve() == top / "bench/drive"
        assert (opened.tree.top / "src/cut.py").read_text() == (top / "src/cut.py").read_text()


def test_a_base_that_is_not_valid(top: Path) -> None:
    edit(spec_of(top), ("r2bspec: 1", "r2bspec: 1\nnonsense: 1"))
    commit(top)
    git(top, "branch", "--force", "main", "HEAD")
    edit(spec_of(top), ("nonsense: 1\n", ""))
    with pytest.raises(R2bspecError) as refused:
        gate()
    assert (refused.value.code, refused.value.exit_code) == ("R2B698", 2)
    (sides,) = gate(allow=["base"])
    assert sides.base is None
    assert any("not judged without a base" in text for text in sides.sentences)


def test_a_base_that_extends_a_file_of_the_work_tree(top: Path) -> None:
    edit(spec_of(top), ("common/limits.yaml", str(top / "bench/common/limits.yaml")))
    commit(top)
    git(top, "branch", "--force", "main", "HEAD")
    with pytest.raises(R2bspecError, match="is outside of the folder"):
        gate()


def test_every_section_of_a_spec_is_gated_or_free() -> None:
    assert {*GATED, *FREE, "slos"} == {*Spec.__struct_fields__}


@pytest.mark.parametrize(
    ("prepared", "played", "refused"),
    [
        (False, "base a, head a, base a, head a", False),
        (False, "base a, head b", True),
        (True, "base a, head b", False),
        (True, "base a, head b, base a, head b", True),
        (True, "base a, head b, base c, head d", True),
    ],
)
def test_what_is_played_is_compared_after_each_run(
    prepared: bool, played: str, refused: bool, top: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a preprocessor makes in one run says nothing yet of the sides."""
    digests = (word.partition(" ") for word in played.split(", "))
    runs = [(side, {"played": digest}) for side, _, digest in digests]
    records = iter([dataset for _, dataset in runs])
    monkeypatch.setattr(merge_gate, "open_run", lambda _: opened_run(next(records)))
    with api.open_gate(BASE) as opened:
        check = RunCheck(opened.tree, frozenset(), is_prepared=prepared, may_differ=False)
        with pytest.raises(R2bspecError, match="input") if refused else nullcontext():
            for side, _ in runs:
                check(side, top)


def opened_run(dataset: dict[str, Any]) -> SimpleNamespace:
    return SimpleNamespace(record=SimpleNamespace(dataset=dataset))


@pytest.mark.parametrize("allowed", [False, True])
def test_a_recording_that_is_rewritten_before_it_is_played_is_refused(
    allowed: bool, top: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Such as by a step of `setup`, where both sides play the same files."""
    (sides,) = gate(allow=["input"] if allowed else [])
    assert sides.check is not None
    (digest,) = sides.check.recordings
    read = {"kind": "recorded", "source": "./drive", "sha256": digest, "played": "a"}
    other = {"kind": "synthetic", "source": "r2b_cafe", "sha256": "made", "played": "a"}
    datasets: Iterator[dict[str, Any]] = iter(
        [read, {**read, "also": [other]}, {**read, "sha256": "another"}]
    )
    monkeypatch.setattr(merge_gate, "open_run", lambda _: opened_run(next(datasets)))
    sides.check("base", top)
    sides.check("head", top)
    with nullcontext() if allowed else pytest.raises(R2bspecError, match="rewritten"):
        sides.check("base", top)


def test_a_module_of_the_change_does_not_take_the_place_of_one_of_r2bspec(
    top: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (top / "src/msgspec.py").touch()
    with api.open_gate(BASE) as opened:
        check_tools(opened.tree)
        module = ModuleType("msgspec")
        module.__file__ = str(top / "src/msgspec.py")
        monkeypatch.setitem(sys.modules, "shadowed", module)
        with pytest.raises(R2bspecError, match="as its own shadowed"):
            check_tools(opened.tree)


def test_an_environment_that_serves_both_sides_has_no_files_of_git(
    top: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "prefix", str(top / ".venv"))
    commit(top, {".venv/lib/python3/site-packages/numpy/fast.py": ""})
    with (
        api.open_gate(BASE) as opened,
        pytest.raises(R2bspecError, match="numpy/fast.py, which is in the Python environment"),
    ):
        check_tools(opened.tree)


def test_a_plan_is_no_spec(top: Path) -> None:
    (top / "bench/words.json").write_bytes(canonical_json(api.prepare(SPEC).plan))
    with pytest.raises(R2bspecError, match="is a plan") as refused:
        gate("bench/words.json")
    assert refused.value.exit_code == 2


def test_a_file_name_stays_on_its_line(top: Path) -> None:
    name = "bench/two\nlines.r2b.yaml"
    shutil.copy(spec_of(top), top / name)
    commit(top)
    git(top, "branch", "--force", "main", "HEAD")
    (top / name).unlink()
    with pytest.raises(R2bspecError) as refused:
        gate()
    assert "\n" not in str(refused.value)
    assert len(gate(allow=["spec bench/two\ufffdlines.r2b.yaml"])) == 1
