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

import check_jsonschema
import pytest
import yaml
from click.testing import CliRunner

from git_repositories import clone, commit, git, write_files
from nightly import only_nightly
from page_blocks import ROOT, page_blocks, page_file
from pipelines import TEMPLATE, stand_in
from r2bspec.compare.base_tree import open_base_tree
from recipe_hosts import GATE, MERGED, Hosts, Upstream, given_arguments

WORKFLOW = page_file("ci.md", ".github/workflows/benchmark.yml")
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
def repository_with_a_pull_request(tmp_path: Path) -> Upstream:
    commit(tmp_path / "upstream", FILES)
    made = Upstream(tmp_path / "upstream")
    made.pull_request({NODE: "# a slower node\n"})
    return made


@pytest.fixture(name="hosts")
def hosts_with_a_stand_in(tmp_path: Path, upstream: Upstream) -> Hosts:
    return Hosts(tmp_path, upstream, str(stand_in(tmp_path)))


EVERY_RECIPE = pytest.mark.parametrize("recipe", ["github", "gitlab", "jenkins", "shell"])


# ---- all recipes mean the same -----------------------------------------------------------------


@EVERY_RECIPE
def test_a_change_is_compared_with_its_base(
    hosts: Hosts, upstream: Upstream, recipe: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    allow = "objective fast\nbase\n"
    code, printed, words = hosts.recipe(recipe, allow=allow)
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
    monkeypatch.chdir(hosts.folder / "checkout")
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
    hosts: Hosts, recipe: str, inconclusive: str, expected: int, sentence: str
) -> None:
    code, printed, _ = hosts.recipe(recipe, inconclusive=inconclusive, STATUS="3")
    assert code == expected, printed
    assert sentence in printed


@EVERY_RECIPE
@pytest.mark.parametrize("environment", [{"STATUS": "4"}, {"NO_RESULT": "1"}], ids=str)
def test_what_does_not_pass_blocks(hosts: Hosts, recipe: str, environment: dict[str, str]) -> None:
    code, printed, _ = hosts.recipe(recipe, inconclusive="pass", **environment)
    assert code == 4, printed


# ---- with r2bspec itself -----------------------------------------------------------------------


WEAKER = SPEC.replace("< 1 s", "< 2 s")


@pytest.mark.parametrize("recipe", ["shell", pytest.param("github", marks=only_nightly())])
def test_a_pull_request_cannot_weaken_its_gate(tmp_path: Path, recipe: str) -> None:
    commit(tmp_path / "upstream", FILES)
    upstream = Upstream(tmp_path / "upstream")
    upstream.pull_request({"bench/blur.r2b.yaml": WEAKER})
    code, printed, _ = Hosts(tmp_path, upstream, sys.executable).recipe(recipe)
    assert code == 2, printed
    assert "objective fast" in printed
    assert "Traceback" not in printed


@EVERY_RECIPE
def test_a_spec_with_spaces_and_a_leading_dash_is_one_word(hosts: Hosts, recipe: str) -> None:
    path = "-a $(touch made)/--help; it's.r2b.yaml"
    code, printed, words = hosts.recipe(recipe, spec=path)
    assert code == 0, printed
    assert words[-2:] == ["--", path]
    assert not list(hosts.folder.rglob("made"))


@EVERY_RECIPE
def test_no_name_or_title_of_a_change_is_a_command(
    hosts: Hosts, upstream: Upstream, recipe: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Names of branches may have almost any character, and titles every one."""
    name = "a;touch${IFS}made;$(touch${IFS}made)`touch${IFS}made`'\"&|touch${IFS}made"
    git(upstream.folder, "branch", name)
    variables = (
        *("GITHUB_HEAD_REF", "GITHUB_BASE_REF", "CI_MERGE_REQUEST_TITLE"),
        *("CI_MERGE_REQUEST_SOURCE_BRANCH_NAME", "CI_MERGE_REQUEST_TARGET_BRANCH_NAME"),
        *("CHANGE_TITLE", "CHANGE_BRANCH", "CHANGE_TARGET"),
    )
    code, printed, words = hosts.recipe(recipe, **dict.fromkeys(variables, name))
    assert code == 0, printed
    assert words[-2:] == ["--", "bench"]
    if recipe == "jenkins":
        assert f"--base=refs/remotes/origin/{name}" in words
        monkeypatch.chdir(hosts.folder / "checkout")
        with open_base_tree(f"refs/remotes/origin/{name}") as tree:
            assert tree.revision.commit == upstream.main
    assert not list(hosts.folder.rglob("made"))


# ---- GitHub ------------------------------------------------------------------------------------


def test_a_base_that_cannot_be_had_blocks_and_says_what_to_fetch(
    tmp_path: Path, upstream: Upstream
) -> None:
    code, printed, _ = Hosts(tmp_path, upstream, sys.executable).recipe("github", base="1" * 40)
    assert code == 2
    assert "R2B694" in printed
    assert "git fetch --depth=1 origin" in printed


# ---- GitLab, Jenkins and shell -----------------------------------------------------------------


def test_the_job_of_the_page_is_the_template(hosts: Hosts) -> None:
    page = yaml.safe_load(GITLAB)
    (include,) = page["include"]
    assert include["remote"].endswith(str(TEMPLATE.relative_to(ROOT)))
    assert page["benchmark"]["extends"] == ".r2bspec"
    place = hosts.place()
    done = place.job(
        hosts.python,
        page["benchmark"]["variables"]["R2BSPEC_SPEC"],
        CI_MERGE_REQUEST_DIFF_BASE_SHA="1" * 40,
        CI_MERGE_REQUEST_TARGET_BRANCH_SHA=hosts.upstream.main,
        STATUS="0",
    )
    assert done.code == 0, done.printed
    assert f"--base={hosts.upstream.main}" in given_arguments(place.checkout)


def test_jenkins_archives_the_reports(hosts: Hosts) -> None:
    hosts.recipe("jenkins")
    assert (hosts.folder / "checkout/r2bspec-artifacts/reports/junit.xml").exists()


def test_the_commands_of_the_page(
    hosts: Hosts, upstream: Upstream, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With a clone as a service makes it, each block is executed; its base is then there."""
    programs = hosts.folder / "bin"
    programs.mkdir()
    (programs / "r2bspec").write_text(f'#!/bin/sh\nexec "{hosts.python}" -I -m r2bspec "$@"\n')
    (programs / "r2bspec").chmod(0o755)
    for number, block in enumerate(b for b in page_blocks("ci.md") if b.kind == "run"):
        options = ["--depth=1"] * (block.argument == "shallow")
        checkout = clone(upstream.folder, hosts.folder / f"clone{number}", MERGED, *options)
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
    words = ["--builtin-schema", schema, str(file)]
    done = CliRunner().invoke(check_jsonschema.main, words)
    assert done.exit_code == 0, done.output


def test_the_inputs_of_the_page_are_those_of_the_action() -> None:
    action = yaml.safe_load((ROOT / "action.yml").read_text())
    page = (ROOT / "docs" / "ci.md").read_text()
    rows = re.findall(r"^\| (`[a-z`, -]+) \|", page, re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`([a-z-]+)`", row)}
    assert named | {"spec"} == set(action["inputs"])
