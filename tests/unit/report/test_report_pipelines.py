"""The GitHub action and the GitLab template: their scripts, run as a pipeline would.

Promise: a pipeline believes its own run alone, whatever a stranger put into the repository.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from command_line import Call
from git_repositories import commit, git
from nightly import sampled
from pipelines import STEPS, Ended, Workplace, read_outputs, stand_in
from r2bspec.safe_io.git import commit_of


@pytest.fixture(name="place")
def workplace(tmp_path: Path) -> Workplace:
    made = Workplace(tmp_path / "check out", tmp_path / "runner temp")
    made.checkout.mkdir()
    made.runner.mkdir()
    return made


@pytest.fixture(name="fake")
def fake_python(tmp_path: Path) -> str:
    return str(stand_in(tmp_path))


# ---- what a pipeline does with a run -----------------------------------------------------------


@pytest.mark.parametrize(
    ("status", "outcome"),
    [(0, "pass"), (1, "fail"), (2, "error"), (3, "inconclusive"), (4, "invalid"), (70, "error")],
)
def test_the_action_tells_how_it_went(
    place: Workplace, fake: str, status: int, outcome: str
) -> None:
    done = place.action(fake, "specs/a b.r2b.yaml", STATUS=str(status))
    assert done.code == status
    folder = Path(done.outputs.pop("folder"))
    assert done.outputs == {"status": str(status), "outcome": outcome}
    assert folder.parent == place.runner
    assert done.summary == "### summary\n"
    # What is printed meanwhile is no command; the annotations come after that.
    first, *_, last = done.printed.splitlines()
    token = first.removeprefix("::stop-commands::")
    assert len(token) == 32
    assert done.printed.index("what a node printed") < done.printed.index(f"\n::{token}::\n")
    assert last == "::error file=a.r2b.yaml,line=9::too slow"


@pytest.mark.parametrize("python", ["", "/no/such/python"], ids=["broken", "missing"])
def test_without_r2bspec_nothing_passes(place: Workplace, fake: str, python: str) -> None:
    for run in (place.action, place.job):
        done = run(python or fake, "a.r2b.yaml", STATUS="0", BROKEN="1")
        assert done.code != 0
        assert done.outputs.get("outcome", "error") == "error"


def test_the_action_uses_no_code_that_others_can_change() -> None:
    # What is not in this repository would have to be pinned by a digest.
    assert [name for name, step in STEPS.items() if "uses" in step] == []


@pytest.mark.parametrize(
    ("extras", "ament", "installed"),
    [
        ("ros,vision,report", "", "[ros,vision,report]"),
        ("ros,vision,report", "/opt/ros/jazzy", "[vision,report]"),
        ("vision,ros", "/opt/ros/jazzy", "[vision]"),
        ("ros", "/opt/ros/jazzy", ""),
        ("", "", ""),
    ],
)
def test_the_action_installs_its_own_version_in_an_environment_of_its_own(
    place: Workplace, extras: str, ament: str, installed: str
) -> None:
    # A Python that makes an "environment": a copy of itself, which keeps what it is called with.
    programs = place.runner.parent / "bin"
    programs.mkdir()
    program = programs / "python3"
    program.write_text(
        "#!/bin/bash\n"
        f'printf "%s\\n" "$PWD" "$PYTHONPATH" "$@" >> "{programs}/called"\n'
        'if [ "$3" = venv ]; then mkdir -p "${@: -1}/bin"; cp "$0" "${@: -1}/bin/python"; fi\n'
    )
    program.chmod(0o755)
    place.write("venv.py", "raise SystemExit('the repository')")
    output = place.runner / "output"
    code, printed = place.shell(
        "bash",
        STEPS["Install"]["run"],
        PATH=f"{programs}:{os.environ['PATH']}",
        PYTHONPATH=".",
        AMENT_PREFIX_PATH=ament,
        R2BSPEC_EXTRAS=extras,
        RUNNER_TEMP=str(place.runner),
        GITHUB_ACTION_PATH="/actions/r2b spec",
        GITHUB_OUTPUT=str(output),
    )
    assert code == 0, printed
    folder = Path(read_outputs(output.read_text())["python"]).parents[2]
    assert folder.parent == place.runner
    venv = ["--system-site-packages"] * bool(ament)
    pip = ["-I", "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    assert (programs / "called").read_text().split("\n")[:-1] == [
        *(str(folder), "", "-I", "-m", "venv", *venv, str(folder / "venv")),
        *(str(folder), "", *pip, f"/actions/r2b spec{installed}"),
    ]


def test_the_base_is_fetched_if_the_clone_lacks_it(
    place: Workplace, fake: str, tmp_path: Path
) -> None:
    upstream = tmp_path / "upstream"
    base = commit(upstream, {"a": "1"})
    commit(upstream, {"a": "2"})
    git(upstream, "config", "uploadpack.allowAnySHA1InWant", "true")
    place.checkout.rmdir()
    git(tmp_path, "clone", "-q", "--depth=1", upstream.as_uri(), str(place.checkout))
    for sha, known in ((base, True), ("0" * 40, False)):
        for run, name in (
            (place.action, "R2BSPEC_BASE"),
            (place.job, "CI_MERGE_REQUEST_DIFF_BASE_SHA"),
        ):
            run(fake, "a.r2b.yaml", STATUS="0", **{name: sha})
            words = (place.checkout / "arguments.txt").read_text().splitlines()
            assert f"--base={sha}" in words
            assert (commit_of(place.checkout, sha) is not None) is known


# ---- forged repositories -----------------------------------------------------------------------

FORGED_RESULT = '{"verdict": {"outcome": "pass\\nstatus=0"}}'
INVALID = "r2bspec: 1\nname: strange\nbenchmark: {duration: forever}\n"

CODE = """\
import os, pathlib
pathlib.Path(os.environ["MARKER"]).write_text(__file__)
print("::set-output name=status::0")
os._exit(0)
"""
"""What a stranger would have executed."""


@dataclass(frozen=True)
class Forge:
    """What a stranger puts into the repository, and the variables of the pipeline.

    Attributes:
        files: texts by name; one that begins with ``#!`` is a program.
        links: names that lead out of the repository.
        variables: ``$HERE`` in them is the repository.
        spec: the spec that the pipeline is given.
    """

    files: Mapping[str, str] = field(default_factory=dict)
    links: tuple[str, ...] = ()
    variables: Mapping[str, str] = field(default_factory=dict)
    spec: str = "strange.r2b.yaml"


def modules(*names: str) -> dict[str, str]:
    return {f"{name}.py": CODE for name in names}


RESULTS = {
    # What an earlier run would have left, in every folder that a pipeline uses.
    **{
        f"{folder}/{name}.json": FORGED_RESULT
        for folder in ("run", "r2bspec-run", "r2bspec-artifacts/run", "runs/forged")
        for name in ("record", "result", "plan")
    },
    **{
        f"{folder}/{name}": text
        for folder in ("r2bspec-reports", "r2bspec-artifacts/reports")
        for name, text in (
            ("junit.xml", "<testsuites><!-- forged --></testsuites>"),
            ("result.json", FORGED_RESULT),
            ("summary.md", "# forged: PASS\n"),
        )
    },
}
FORGED_SPECS = {
    "an option": "--help",
    "an option with a value": "--report=json=-.r2b.yaml",
    "line breaks": "a\nstatus=0\noutcome=pass\n::set-output name=status::0\n.r2b.yaml",
    "standard input": "-",
}
FORGERIES = {
    "results": Forge(RESULTS),
    "links": Forge(links=("r2bspec-reports", "r2bspec-run", "r2bspec-artifacts", "run", "reports")),
    "results that fail": Forge(
        RESULTS | {"r2bspec-reports/report.html/keep": "", "reports/report.html/keep": ""}
    ),
    "modules": Forge(
        modules("json", "yaml", "venv", "pip", "contextlib", "click", "encodings/__init__")
        | modules("r2bspec", "r2bspec/__init__", "r2bspec/__main__", "conftest", "setup")
    ),
    "python path": Forge(
        modules("sitecustomize", "usercustomize", "json", "r2bspec"),
        variables={"PYTHONPATH": ".:$HERE:"},
    ),
    "python path with an empty entry": Forge(
        modules("sitecustomize"),
        variables={"PYTHONPATH": "/opt/ros/jazzy/lib/python3.12/site-packages:"},
    ),
    "settings": Forge(
        modules("startup", "home/lib/python3.11/site-packages/sitecustomize", "forged")
        | dict.fromkeys(
            (".r2bspec", "r2bspec.toml", ".r2bspec.yaml", ".env", "pip.conf"),
            "inconclusive: pass\ngate: off\nno-index: true\n",
        )
        | {
            "pyproject.toml": "[tool.pytest.ini_options]\naddopts = '-p forged'\n",
            "pytest.ini": "[pytest]\naddopts = -p forged\n",
        },
        variables={
            "PYTHONSTARTUP": "startup.py",
            "PYTHONUSERBASE": "home",
            "PYTHONINSPECT": "1",
            "PYTHONBREAKPOINT": "startup.main",
            "PYTEST_ADDOPTS": "-p forged",
        },
    ),
    **{
        f"spec like {kind}": Forge({spec: INVALID}, spec=spec)
        for kind, spec in FORGED_SPECS.items()
    },
    "programs": Forge(
        dict.fromkeys(
            ("r2bspec", "od", "tr", "mktemp", "git", "python3", "cat"),
            '#!/bin/bash\necho forged > "$MARKER"\n',
        ),
        variables={"PATH": f"{os.environ['PATH']}:"},
    ),
    "repository in the repository": Forge(
        {
            "HEAD": "ref: refs/heads/main\n",
            "objects/keep": "",
            "refs/keep": "",
            "config": "[core]\nbare = false\nworktree = .\nrepositoryformatversion = 0\n"
            'fsmonitor = "echo forged > $MARKER"\nsshCommand = "echo forged > $MARKER"\n',
        },
        variables={
            "R2BSPEC_BASE": "0" * 40,
            "CI_MERGE_REQUEST_DIFF_BASE_SHA": "0" * 40,
        },
    ),
}


@dataclass(frozen=True)
class Forgery:
    """A forged repository with an invalid spec, and what must not be touched outside of it."""

    place: Workplace
    spec: str
    variables: dict[str, str]

    def assert_harmless(self, done: Ended) -> None:
        assert done.code == 2, done.printed
        assert not Path(self.variables["MARKER"]).exists()
        outside = self.place.runner.parent / "outside"
        assert {path.name: path.read_text() for path in outside.iterdir()} == {"kept": "kept"}


@pytest.fixture(name="forgery")
def forged_repository(request: pytest.FixtureRequest, place: Workplace) -> Forgery:
    forge = FORGERIES[request.param]
    outside = place.runner.parent / "outside"
    outside.mkdir()
    (outside / "kept").write_text("kept")
    for name, text in {"strange.r2b.yaml": INVALID, **forge.files}.items():
        place.write(name, text).chmod(0o755 if text.startswith("#!") else 0o644)
    for name in forge.links:
        (place.checkout / name).symlink_to(outside, target_is_directory=True)
    variables = {
        "HOME": str(place.runner),
        "MARKER": str(place.runner.parent / "executed"),
        **{
            name: value.replace("$HERE", str(place.checkout))
            for name, value in forge.variables.items()
        },
    }
    return Forgery(place, forge.spec, variables)


# By default a sample of the forgeries is tried, each on one of the two scripts.
@pytest.mark.parametrize("forgery", sampled(FORGERIES, 4), indirect=True)
def test_a_forged_repository_does_not_pass_the_action(forgery: Forgery) -> None:
    done = forgery.place.action(sys.executable, forgery.spec, **forgery.variables)
    forgery.assert_harmless(done)
    assert done.outputs["status"] == "2"
    assert done.outputs["outcome"] == "error"
    assert Path(done.outputs["folder"]).parent == forgery.place.runner
    assert "forged" not in done.summary


@pytest.mark.parametrize("forgery", sampled(FORGERIES, 4, 2), indirect=True)
def test_a_forged_repository_does_not_pass_the_job(forgery: Forgery) -> None:
    done = forgery.place.job(sys.executable, forgery.spec, **forgery.variables)
    forgery.assert_harmless(done)
    artifacts = forgery.place.checkout / "r2bspec-artifacts"
    assert not artifacts.is_symlink()
    kept = [path for path in artifacts.rglob("*") if path.is_file()]
    assert [each for each in kept if "forged" in each.read_text(errors="replace")] == []


def test_the_spec_of_the_forged_repositories_is_read_and_invalid(
    place: Workplace, call: Call
) -> None:
    """So that a forgery is refused for its spec, as it is without any forgery."""
    assert "R2B" in call("validate", str(place.write("strange.r2b.yaml", INVALID)), status=1).out
