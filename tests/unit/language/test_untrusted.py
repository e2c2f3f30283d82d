"""Promise: an untrusted spec reads the variables that its base version lists, and no other."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import pytest

from command_line import Call
from example_spec import example
from git_repositories import commit, git, write_files
from r2bspec.api import UntrustedPlanError, prepare
from r2bspec.cli.main import main
from r2bspec.language.environment_access import BaseVersionError, UntrustedSpecs, base_version
from r2bspec.language.load_spec import load_spec

SPEC = example()


class Repository:
    """A repository with a base, and a change of it in the working tree."""

    def __init__(self, top: Path) -> None:
        self.top = top
        git(top, "init", "-q", "-b", "main")

    def write(self, files: Mapping[str, str]) -> None:
        write_files(self.top, files)

    def commit(self, files: Mapping[str, str]) -> str:
        return commit(self.top, files)

    def refused(self, name: str, reference: str = "main") -> list[str]:
        """The variables that the spec of that name in the working tree must not read."""
        untrusted = UntrustedSpecs(base_version(reference, self.top))
        environ = {"DATA": "/data", "TOKEN": "secret"}
        found = load_spec(self.top / name, environ=environ, untrusted=untrusted).diagnostics
        assert {one.code for one in found} <= {"R2B143"}, found
        return [one.message.split()[5].rstrip(":") for one in found]


@pytest.fixture(name="repository")
def new_repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Repository:
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", "/dev/null")
    top = tmp_path / "a repository"
    top.mkdir()
    monkeypatch.chdir(top)
    return Repository(top)


def lists(*names: str) -> str:
    return f"{SPEC}environment: [{', '.join(names)}]\n"


def test_without_a_base_no_variable_is_allowed() -> None:
    text = SPEC + "environment: [DATA]\ntitle: $(env DATA)\n"
    assert load_spec(text, environ={"DATA": "/data"}).spec is not None
    loaded = load_spec(text, environ={"DATA": "/data"}, untrusted=UntrustedSpecs())
    (found,) = loaded.diagnostics
    assert (found.code, found.severity) == ("R2B143", "error")
    assert (found.span.line, found.span.column) == (text.count("\n") - 1, 15)
    assert "/data" not in str(loaded.diagnostics)
    assert load_spec(SPEC, environ={}, untrusted=UntrustedSpecs()).spec is not None


def test_what_the_base_version_lists_is_allowed(repository: Repository) -> None:
    repository.commit({"specs/a.r2b.yaml": lists("DATA"), "specs/b.r2b.yaml": SPEC})
    assert repository.refused("specs/a.r2b.yaml") == []
    repository.write({"specs/a.r2b.yaml": lists("DATA", "TOKEN")})
    assert repository.refused("specs/a.r2b.yaml") == ["TOKEN"]
    # One that lists nothing there, a new one, and one of the same name in another folder.
    for name in ("specs/b.r2b.yaml", "specs/new.r2b.yaml", "a.r2b.yaml"):
        repository.write({name: lists("DATA")})
        assert repository.refused(name) == ["DATA"]


def test_what_is_extended_is_read_from_the_base(repository: Repository) -> None:
    repository.commit(
        {
            "common/base.yaml": "extends: inner.yaml\n",
            "common/inner.yaml": "environment: [DATA]\n",
            "a.r2b.yaml": f"{SPEC}extends: common/base.yaml\n",
            "b.r2b.yaml": SPEC,
            "c.r2b.yaml": f"{SPEC}extends: common/base.yaml\nenvironment: []\n",
        }
    )
    assert repository.refused("a.r2b.yaml") == []
    repository.write(
        {
            "common/inner.yaml": "environment: [DATA, TOKEN]\n",
            # A file of the base is no permission for a spec that did not extend it there.
            "b.r2b.yaml": f"{SPEC}extends: common/base.yaml\n",
            "c.r2b.yaml": f"{SPEC}extends: common/base.yaml\n",
            "new.r2b.yaml": f"{SPEC}extends: common/base.yaml\n",
        }
    )
    assert repository.refused("a.r2b.yaml") == ["TOKEN"]
    for name in ("b.r2b.yaml", "c.r2b.yaml", "new.r2b.yaml"):
        assert repository.refused(name) == ["DATA", "TOKEN"]


@pytest.mark.parametrize(
    "base",
    [
        "environment: DATA\n",
        "environment: {DATA: 1}\n",
        "- environment: [DATA]\n",
        "environment: [DATA\n",
        "extends: a.r2b.yaml\n",
        "extends: ../../a.r2b.yaml\n",
        "extends: [b.yaml, {a: b}]\n",
        "extends: nothing.yaml\n",
        "\0environment: [DATA]\n",
        "",
    ],
)
def test_a_base_that_lists_nothing_allows_nothing(repository: Repository, base: str) -> None:
    repository.commit({"a.r2b.yaml": base})
    repository.write({"a.r2b.yaml": lists("DATA")})
    assert repository.refused("a.r2b.yaml") == ["DATA"]


def test_a_link_in_the_base_is_no_spec(repository: Repository) -> None:
    repository.write({"other.yaml": lists("DATA")})
    (repository.top / "a.r2b.yaml").symlink_to("other.yaml")
    repository.commit({})
    (repository.top / "a.r2b.yaml").unlink()
    repository.write({"a.r2b.yaml": lists("DATA")})
    assert repository.refused("a.r2b.yaml") == ["DATA"]


def test_files_outside_of_the_repository_are_not_in_the_base(repository: Repository) -> None:
    repository.commit({"a.r2b.yaml": lists("DATA")})
    outside = repository.top.parent / "a.r2b.yaml"
    outside.write_text(lists("DATA"))
    assert repository.refused(str(outside)) == ["DATA"]
    untrusted = UntrustedSpecs(base_version("main", repository.top))
    for file in ("<text>", "-", "\0", "a" * 5000):
        found = load_spec(lists("DATA"), file=file, environ={}, untrusted=untrusted).diagnostics
        assert [one.code for one in found] == ["R2B143"]


@pytest.mark.parametrize(
    "name", ["a\nb.r2b.yaml", "--x.r2b.yaml", ":(glob)*.r2b.yaml", "é ü.r2b.yaml"]
)
def test_odd_names_of_specs(repository: Repository, name: str) -> None:
    repository.commit({name: lists("DATA")})
    repository.write({name: lists("DATA", "TOKEN")})
    assert repository.refused(name) == ["TOKEN"]


def test_a_work_tree_of_another_repository(repository: Repository, tmp_path: Path) -> None:
    repository.commit({"a.r2b.yaml": lists("DATA")})
    other = tmp_path / "other"
    git(repository.top, "worktree", "add", "-q", str(other), "-b", "change")
    (other / "a.r2b.yaml").write_text(lists("DATA", "TOKEN"))
    untrusted = UntrustedSpecs(base_version("main", other))
    loaded = load_spec(other / "a.r2b.yaml", environ={"DATA": "1"}, untrusted=untrusted)
    assert [diagnostic.code for diagnostic in loaded.diagnostics] == ["R2B143"]


def test_a_repository_below_the_working_tree_is_not_asked(
    repository: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A bare repository can be committed, and its configuration can name programs."""
    commit = repository.commit({"specs/a.r2b.yaml": lists("DATA")})
    marker = repository.top.parent / "executed"
    git(repository.top, "clone", "-q", "--bare", ".", "specs/bare")
    for each in (repository.top / "specs/bare").iterdir():
        each.rename(repository.top / "specs" / each.name)
    config = repository.top / "specs" / "config"
    config.write_text(
        f'[core]\nbare = false\nworktree = .\nfsmonitor = "touch {marker}; false"\n'
        f'alternateRefsCommand = "touch {marker}"\n[alias]\ncat-file = "!touch {marker}"\n'
    )
    repository.write({"specs/a.r2b.yaml": lists("DATA", "TOKEN")})
    monkeypatch.chdir(repository.top / "specs")
    monkeypatch.setenv("GIT_DIR", str(repository.top / "specs"))
    assert repository.refused("specs/a.r2b.yaml", commit) == ["TOKEN"]
    assert base_version("main", Path.cwd()).top == repository.top.resolve()
    assert not marker.exists()


@pytest.mark.parametrize(
    "reference", ["nothing", "--help", "-p", "", "HEAD:a.r2b.yaml", "a b", "\0"]
)
def test_a_base_that_is_no_commit(repository: Repository, reference: str) -> None:
    repository.commit({"a.r2b.yaml": SPEC})
    with pytest.raises(BaseVersionError) as caught:
        base_version(reference, repository.top)
    assert (caught.value.code, caught.value.exit_code) == ("R2B667", 2)


def test_a_base_without_a_repository_or_without_git(
    repository: Repository, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(BaseVersionError, match="not in a git repository"):
        base_version("main", tmp_path)
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(BaseVersionError, match="git cannot be executed"):
        base_version("main", repository.top)


# ---- the verbs ---------------------------------------------------------------------------------


@pytest.mark.parametrize("verb", [["validate"], ["plan"], ["run", "--quiet", "--output=run"]])
def test_verbs_refuse_what_the_base_does_not_list(
    verb: list[str],
    repository: Repository,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("DATA", "/data-of-the-runner")
    monkeypatch.delenv("R2B_DATASETS", raising=False)
    repository.commit(
        {"a.r2b.yaml": SPEC, "listed.r2b.yaml": f"{lists('DATA')}title: $(env DATA)\n"}
    )
    change = "environment: [DATA] # r2bspec: ignore[R2B143] mine\ntitle: $(env DATA)\n"
    repository.write({"a.r2b.yaml": SPEC + change})
    for options in (["--untrusted"], ["--untrusted", "--base-ref=main"]):
        assert main([*verb, *options, "a.r2b.yaml"]) in {1, 2}
        said = "".join(capsys.readouterr())
        assert "error[R2B143" in said
        assert "/data-of-the-runner" not in said
    assert not (repository.top / "run").exists()
    if verb != ["validate"]:
        assert main([*verb, "--untrusted", "listed.r2b.yaml"]) == 2
    else:
        assert main(["validate", "--untrusted", "--base-ref=main", "listed.r2b.yaml"]) == 0
        assert main(["validate", "a.r2b.yaml"]) == 0


def test_a_base_of_nothing_is_wrong_usage(repository: Repository, call: Call) -> None:
    repository.commit({"a.r2b.yaml": SPEC})
    ended = call("validate", "--base-ref=main", "a.r2b.yaml", status=2)
    assert "--base-ref needs --untrusted" in ended.err
    ended = call("validate", "--untrusted", "--base-ref=nothing", "a.r2b.yaml", status=2)
    assert "R2B667" in ended.err


def test_an_untrusted_plan_reads_no_variable(
    repository: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("R2B_DATASETS", raising=False)
    repository.commit({"a.r2b.yaml": SPEC})
    file = repository.top / "plan.json"
    assert main(["plan", "a.r2b.yaml", "-o", str(file)]) == 0
    assert prepare(file, untrusted=UntrustedSpecs()).plan.name == "example"
    plan = json.loads(file.read_text())
    file.write_text(json.dumps(plan | {"environment": ["AWS_*"]}))
    with pytest.raises(UntrustedPlanError, match=r"AWS_\*") as caught:
        prepare(file, untrusted=UntrustedSpecs())
    assert (caught.value.code, caught.value.exit_code) == ("R2B143", 2)


def test_the_base_of_a_comparison_is_untrusted_as_the_head_is(
    repository: Repository, call: Call, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("R2B_DATASETS", raising=False)
    repository.commit({"a.r2b.yaml": SPEC})
    repository.write({"other.r2b.yaml": lists("DATA")})
    options = ["--untrusted", "--base-ref=main", "--output=run", "--quiet"]
    ended = call("run", *options, "--against=other.r2b.yaml", "a.r2b.yaml", status=2)
    assert "error[R2B143" in ended.err
