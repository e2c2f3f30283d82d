"""Promise: every recipe of docs/ci.md works as it stands there, and all of them mean the same.

A pull request is a real one, in a real repository, which the recipe's own scripts check out and
fetch from. Where only the scripts are examined, a program stands for r2bspec.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from git_repositories import git, write_files
from github_runner import Event
from github_service import Upstream
from page_blocks import ROOT, page_blocks, page_file
from pipelines import TEMPLATE, Workplace, stand_in
from r2bspec.compare.base_tree import open_base_tree
from recipe_hosts import GATE, WORKFLOW, Hosts, given_arguments

GITLAB = page_file("ci.md", ".gitlab-ci.yml")

NODE = "src/blur/blur/blur.py"
SPEC = """\
r2bspec: 1
name: blur
data_loader: {bag: r2b_storage, topics: {/d455_1_rgb_image: image}}
playback: {inputs: {input: {from: image, format: sensor_msgs/msg/Image}}}
graph:
  nodes:
    relay: {python: r2bspec.nodes.RelayNode, parameters: {format: sensor_msgs/msg/Image}}
monitors: {out: {topic: output, format: sensor_msgs/msg/Image}}
benchmark: {rates: [10 Hz], duration: 1 s, iterations: 2}
slos:
  fast: {at: 10 Hz, require: [latency.p50 < 1 s]}
"""
FILES = {NODE: "# the node\n", "bench/blur.r2b.yaml": SPEC}

BLOCKS = "The run is inconclusive. It blocks, unless inconclusive is pass."
PASSES = "The run is inconclusive. It passes, because inconclusive is pass."


@pytest.fixture(name="upstream")
def repository(tmp_path: Path) -> Upstream:
    return Upstream.create(tmp_path / "upstream", FILES)


@pytest.fixture(name="change")
def pull_request(upstream: Upstream) -> Event:
    return upstream.pull_request({NODE: "# a slower node\n"})


@pytest.fixture(name="hosts")
def hosts_with_a_stand_in(tmp_path: Path, upstream: Upstream) -> Hosts:
    return Hosts(tmp_path, upstream, str(stand_in(tmp_path)))


EVERY_RECIPE = pytest.mark.parametrize("recipe", ["github", "gitlab", "jenkins", "shell"])


# ---- all recipes mean the same -----------------------------------------------------------------


@EVERY_RECIPE
def test_a_change_is_compared_with_its_base(
    hosts: Hosts,
    upstream: Upstream,
    change: Event,
    recipe: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    allow = "objective fast\nbase\n"
    code, printed, words = hosts.recipe(recipe, change, allow=allow)
    assert code == 0, printed
    assert words[0] == "gate"
    assert words[-2:] == ["--", "bench"]
    assert [word for word in words if word.startswith("--allow")] == [
        "--allow=objective fast",
        "--allow=base",
    ]
    (base,) = [word for word in words if word.startswith("--base=")]
    assert re.match("--base=(refs/remotes/origin/|[0-9a-f]{40}$)", base), "a full name"
    # The base is in the clone, as r2bspec itself looks it up.
    monkeypatch.chdir(hosts.folder / ("runner/checkout" if recipe == "github" else "checkout"))
    with open_base_tree(base.removeprefix("--base=")) as tree:
        assert not tree.notes
        assert tree.revision.commit == upstream.main
        assert (tree.top / NODE).read_text() == FILES[NODE]
        assert (tree.head_top / NODE).read_text() == "# a slower node\n"


@EVERY_RECIPE
@pytest.mark.parametrize(
    ("inconclusive", "expected", "sentence"), [("", 3, BLOCKS), ("pass", 0, PASSES)]
)
def test_inconclusive_means_the_same_everywhere(
    hosts: Hosts, change: Event, recipe: str, inconclusive: str, expected: int, sentence: str
) -> None:
    code, printed, _ = hosts.recipe(recipe, change, inconclusive=inconclusive, STATUS="3")
    assert code == expected, printed
    assert sentence in printed


@EVERY_RECIPE
@pytest.mark.parametrize("environment", [{"STATUS": "4"}, {"NO_RESULT": "1"}], ids=str)
def test_what_does_not_pass_blocks(
    hosts: Hosts, change: Event, recipe: str, environment: dict[str, str]
) -> None:
    code, printed, _ = hosts.recipe(recipe, change, inconclusive="pass", **environment)
    assert code == 4, printed


# ---- with r2bspec itself -----------------------------------------------------------------------


WEAKER = SPEC.replace("< 1 s", "< 2 s")


@pytest.mark.parametrize(
    ("recipe", "files", "deleted", "message"),
    [
        # A weaker objective goes through every recipe below.
        ("github", {"bench/blur.r2b.yaml": SPEC.partition("slos:")[0]}, (), "R2B693"),
        # The other spec is broken, so that nothing runs.
        (
            "shell",
            {"bench/a.r2b.yaml": "r2bspec: 1\n"},
            ("bench/blur.r2b.yaml",),
            "spec bench/blur.r2b.yaml",
        ),
    ],
    ids=["without objectives", "deleted"],
)
def test_a_pull_request_cannot_weaken_its_gate(
    tmp_path: Path,
    upstream: Upstream,
    recipe: str,
    files: dict[str, str],
    deleted: tuple[str, ...],
    message: str,
) -> None:
    change = upstream.pull_request(files, deleted)
    code, printed, _ = Hosts(tmp_path, upstream, sys.executable).recipe(recipe, change)
    assert code == 2, printed
    assert message in printed
    assert "Traceback" not in printed


@EVERY_RECIPE
def test_a_weaker_objective_is_refused_also_where_a_spec_has_spaces_and_a_leading_dash(
    tmp_path: Path, upstream: Upstream, recipe: str
) -> None:
    path = "-a $(touch made)/--help; it's.r2b.yaml"
    upstream.replace_main({path: SPEC})
    change = upstream.pull_request({path: WEAKER})
    hosts = Hosts(tmp_path, upstream, sys.executable)
    code, printed, _ = hosts.recipe(recipe, change, spec=path)
    assert code == 2, printed
    assert "objective fast" in printed
    assert "Traceback" not in printed
    assert not list(tmp_path.rglob("made"))


@EVERY_RECIPE
def test_no_name_or_title_of_a_change_is_a_command(
    hosts: Hosts, upstream: Upstream, recipe: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names of branches may have almost any character, and titles every one."""
    name = "a;touch${IFS}made;$(touch${IFS}made)`touch${IFS}made`'\"&|touch${IFS}made"
    git(upstream.folder, "branch", name)
    change = upstream.pull_request({NODE: "# another\n"})
    pull_request = change.payload["pull_request"]
    pull_request |= {"title": name, "body": name}
    pull_request["head"] |= {"ref": name}
    pull_request["base"] |= {"ref": name}
    variables = (
        *("GITHUB_HEAD_REF", "GITHUB_BASE_REF", "CI_MERGE_REQUEST_TITLE"),
        *("CI_MERGE_REQUEST_SOURCE_BRANCH_NAME", "CI_MERGE_REQUEST_TARGET_BRANCH_NAME"),
        *("CHANGE_TITLE", "CHANGE_BRANCH", "CHANGE_TARGET"),
    )
    code, printed, words = hosts.recipe(recipe, change, **dict.fromkeys(variables, name))
    assert code == 0, printed
    assert words[-2:] == ["--", "bench"]
    if recipe == "jenkins":
        assert f"--base=refs/remotes/origin/{name}" in words
        monkeypatch.chdir(hosts.folder / "checkout")
        with open_base_tree(f"refs/remotes/origin/{name}") as tree:
            assert tree.revision.commit == upstream.main
    assert not list(hosts.folder.rglob("made"))


# ---- GitHub ------------------------------------------------------------------------------------


def test_the_workflow_reports_uploads_and_gates(hosts: Hosts, change: Event) -> None:
    job, _ = hosts.github(change, STATUS="1")
    assert job.failed
    assert job.outputs["gate"]["outcome"] == "fail"
    assert job.summary == "### summary\n"
    assert "::error file=a.r2b.yaml,line=9::too slow" in job.printed
    assert job.uploaded == [Path(job.outputs["gate"]["folder"])]
    assert job.skipped == ["Install"]


def test_a_base_that_cannot_be_had_blocks_and_says_what_to_fetch(
    tmp_path: Path, upstream: Upstream, change: Event
) -> None:
    lost = {"pull_request": {**change.payload["pull_request"], "base": {"sha": "1" * 40}}}
    hosts = Hosts(tmp_path, upstream, sys.executable)
    job, _ = hosts.github(Event("pull_request", change.ref, lost))
    assert job.failed
    assert job.outputs["gate"]["status"] == "2"
    assert "R2B694" in job.printed
    assert "git fetch --depth=1 origin" in job.printed


# ---- GitLab, Jenkins and shell -----------------------------------------------------------------


def test_the_job_of_the_page_is_the_template(hosts: Hosts, change: Event) -> None:
    page = yaml.safe_load(GITLAB)
    (include,) = page["include"]
    assert include["remote"].endswith(str(TEMPLATE.relative_to(ROOT)))
    assert page["benchmark"]["extends"] == ".r2bspec"
    place = Workplace(hosts.checkout(change), hosts.folder / "runner")
    place.runner.mkdir()
    done = place.job(
        hosts.python,
        page["benchmark"]["variables"]["R2BSPEC_SPEC"],
        CI_MERGE_REQUEST_DIFF_BASE_SHA="1" * 40,
        CI_MERGE_REQUEST_TARGET_BRANCH_SHA=hosts.upstream.main,
        STATUS="0",
    )
    assert done.code == 0, done.printed
    assert f"--base={hosts.upstream.main}" in given_arguments(place.checkout)


def test_jenkins_archives_the_reports(hosts: Hosts, change: Event) -> None:
    hosts.recipe("jenkins", change)
    assert (hosts.folder / "checkout/r2bspec-artifacts/reports/junit.xml").exists()


def test_the_commands_of_the_page(
    hosts: Hosts, upstream: Upstream, change: Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a clone as a service makes it, each block is executed; its base is then there."""
    programs = hosts.folder / "bin"
    programs.mkdir()
    (programs / "r2bspec").write_text(f'#!/bin/sh\nexec "{hosts.python}" -I -m r2bspec "$@"\n')
    (programs / "r2bspec").chmod(0o755)
    for number, block in enumerate(b for b in page_blocks("ci.md") if b.kind == "run"):
        options = ["--depth=1"] * (block.argument == "shallow")
        checkout = upstream.clone(hosts.folder / f"clone{number}", change.ref, *options)
        if number == 0:
            git(checkout, "fetch", "--quiet", "origin", "main:refs/remotes/origin/main")
        write_files(checkout, {"ci/gate.sh": GATE.read_text()})
        done = subprocess.run(
            ["sh", "-e", "-c", "\n".join(block.commands)],  # noqa: S607
            cwd=checkout,
            env={
                **os.environ,
                "PATH": f"{programs}:{os.environ['PATH']}",
                "R2BSPEC_PYTHON": hosts.python,
                "STATUS": "0",
            },
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        words = given_arguments(checkout)
        assert "bench" in words
        at = next(i for i, word in enumerate(words) if word.startswith("--base"))
        base = words[at].partition("=")[2] or words[at + 1]
        monkeypatch.chdir(checkout)
        with open_base_tree(base) as tree:
            assert tree.revision.commit == upstream.main


# ---- what the services read --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("schema", "text"),
    [
        ("vendor.github-actions", (ROOT / "action.yml").read_text()),
        ("vendor.github-workflows", WORKFLOW),
        (
            "vendor.github-workflows",
            page_file("tutorial.md", "robot/.github/workflows/benchmark.yml"),
        ),
        # As the job that extends it: of a hidden one the schema says nothing.
        ("vendor.gitlab-ci", TEMPLATE.read_text().replace(".r2bspec:", "benchmark:")),
        ("vendor.gitlab-ci", GITLAB),
    ],
    ids=["action", "workflow", "workflow of the tutorial", "template", "job"],
)
def test_the_service_can_read_it(schema: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / "file.yml"
    file.write_text(text)
    words = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema, str(file)]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_the_inputs_of_the_page_are_those_of_the_action() -> None:
    action = yaml.safe_load((ROOT / "action.yml").read_text())
    page = (ROOT / "docs" / "ci.md").read_text()
    rows = re.findall(r"^\| (`[a-z`, -]+) \|", page, re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([a-z-]+)`", row)}
    assert named | {"spec"} == set(action["inputs"])


# ---- the runner of these tests -----------------------------------------------------------------
