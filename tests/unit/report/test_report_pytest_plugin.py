"""The pytest plugin: specs are tests if that is asked for, and nothing at all otherwise."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from example_spec import example
from run_simulation import Played, Simulation, objective

REQUIRED = ("latency.p50 < 60 ms", "latency.p50 < 1 ms", "throughput.mean > 29.999999 Hz")
SPEC = example(
    "simulated",
    data_loader="{bag: nowhere, topics: {/a: image_raw}}",
    monitors="{detections: {topic: output, format: sensor_msgs/msg/Image}}",
    benchmark="{rates: [30 Hz], iterations: 2}",
    slos=f"{{fast: {{at: 30 Hz, require: [{', '.join(REQUIRED)}]}}}}",
)


class Done(NamedTuple):
    """What a run of pytest ended with."""

    returncode: int
    stdout: str
    stderr: str


Run = Callable[..., Done]


@pytest.fixture
def pytest_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Run pytest with the plugin in a folder; in this process, which has imported everything."""
    monkeypatch.setenv("PYTEST_DISABLE_PLUGIN_AUTOLOAD", "1")
    monkeypatch.setenv("NO_COLOR", "1")

    def run(folder: Path, *arguments: str) -> Done:
        monkeypatch.chdir(folder)
        # The inner one searches no garbage at its end, which is that of all tests so far.
        plugins = ("r2bspec.pytest_plugin", "no:faulthandler", "no:unraisableexception")
        options = [word for name in plugins for word in ("-p", name)]
        status = pytest.main([*options, "-rA", *arguments])
        return Done(int(status), *capsys.readouterr())

    return run


@pytest.fixture(name="folder")
def project(tmp_path: Path) -> Path:
    (tmp_path / "simulated.r2b.yaml").write_text(SPEC)
    Simulation(
        segments=[Played(30, [0.02] * 300), Played(30, [0.02] * 299 + [0.03])],
        objectives={"fast": objective(*REQUIRED)},
    ).write(tmp_path / "runs" / "simulated")
    return tmp_path


RUNS = ("--r2bspec", "--r2bspec-runs", "runs")


def test_each_requirement_is_a_test_and_inconclusive_fails_unless_told_otherwise(
    folder: Path, pytest_run: Run
) -> None:
    name = "simulated.r2b.yaml::fast:"
    # What pytest-lsp adds to every test expects that it may have fixtures.
    done = pytest_run(folder, "-p", "pytest_lsp", *RUNS)
    assert done.returncode == 1
    assert "PASSED simulated.r2b.yaml::valid" in done.stdout
    assert f"PASSED {name} latency.p50 < 60 ms" in done.stdout
    assert f"FAILED {name} latency.p50 < 1 ms" in done.stdout
    assert f"FAILED {name} throughput.mean > 29.999999 Hz" in done.stdout
    assert "✘ FAIL" in done.stdout
    assert "Traceback" not in done.stdout
    done = pytest_run(folder, *RUNS, "--r2bspec-inconclusive", "skip")
    assert "SKIPPED" in done.stdout
    assert f"FAILED {name} throughput.mean > 29.999999 Hz" not in done.stdout


def test_a_broken_spec_is_explained_with_its_line(folder: Path, pytest_run: Run) -> None:
    (folder / "simulated.r2b.yaml").write_text(SPEC.replace("< 1 ms", "< 1 Hz"))
    done = pytest_run(folder, *RUNS)
    assert done.returncode == 1
    assert f"simulated.r2b.yaml:{len(SPEC.splitlines())}:" in done.stdout


MATRIX = """\
variables: {queue: 1}
matrix: {axes: {queue: [1, 10]}}
"""


def test_the_cases_of_a_matrix_are_parameters(tmp_path: Path, pytest_run: Run) -> None:
    (tmp_path / "simulated.r2b.yaml").write_text(SPEC + MATRIX)
    for case, latency_s in (("1", 0.02), ("10", 0.2)):
        Simulation(
            segments=[Played(30, [latency_s] * 300), Played(30, [latency_s] * 300)],
            objectives={"fast": objective("latency.p50 < 60 ms")},
        ).write(tmp_path / "runs" / f"simulated_queue={case}")
    done = pytest_run(tmp_path, "--r2bspec", "--r2bspec-runs", "runs", "-k", "valid or 60")
    assert "PASSED simulated.r2b.yaml::valid[queue=1]" in done.stdout
    assert "PASSED simulated.r2b.yaml::valid[queue=10]" in done.stdout
    assert "PASSED simulated.r2b.yaml::fast: latency.p50 < 60 ms[queue=1]" in done.stdout
    assert "FAILED simulated.r2b.yaml::fast: latency.p50 < 60 ms[queue=10]" in done.stdout
    assert "R2B140" not in done.stdout


def test_the_name_of_a_test_is_one_line(folder: Path, pytest_run: Run) -> None:
    requirement = '"latency.p50\\n< 60 ms"'
    (folder / "lines.r2b.yaml").write_text(
        SPEC.replace("name: simulated", "name: lines").replace(REQUIRED[0], requirement)
        + 'variables: {queue: x}\nmatrix: {axes: {queue: ["a\\nb"]}}\n'
    )
    done = pytest_run(folder, "--r2bspec", "--collect-only", "-q", "lines.r2b.yaml")
    names = [line for line in done.stdout.splitlines() if line.startswith("lines.r2b.yaml::")]
    assert len(names) == 1 + len(REQUIRED), done.stdout
    assert all(name.endswith("]") for name in names), names


def test_a_spec_may_be_a_link_within_its_work_tree(
    folder: Path, tmp_path: Path, pytest_run: Run
) -> None:
    project = tmp_path / "project"
    project.mkdir()
    (project / "linked.r2b.yaml").symlink_to(folder / "simulated.r2b.yaml")
    arguments = ("--r2bspec", "--r2bspec-runs", str(folder / "runs"))
    done = pytest_run(project, *arguments)
    assert "FAILED linked.r2b.yaml::valid" in done.stdout
    assert "it is a link out of its folder" in done.stdout
    (tmp_path / ".git").mkdir()
    done = pytest_run(project, *arguments)
    assert "PASSED linked.r2b.yaml::valid" in done.stdout
    assert "PASSED linked.r2b.yaml::fast: latency.p50 < 60 ms" in done.stdout


def test_what_a_spec_says_does_not_control_the_terminal(folder: Path, pytest_run: Run) -> None:
    spec = folder / "simulated.r2b.yaml"
    spec.write_bytes(
        SPEC.encode().replace(b"bag: nowhere", b'bag: "./\\x9b31m\\e]0;x\\a\\n::error::x"')
    )
    done = pytest_run(folder, "--r2bspec")
    assert "R2B301" in done.stdout
    assert "\x1b" not in done.stdout
    assert "\x9b" not in done.stdout
    assert not any(line.lstrip().startswith("::error") for line in done.stdout.splitlines())
