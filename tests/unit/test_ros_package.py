"""The repository is a package of ROS: its manifest, what colcon installs, and ament's tests."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from nightly import sampled
from page_blocks import page_file
from r2bspec._version import __version__
from r2bspec.cli.run import command as run_command

ROOT = Path(__file__).parents[2]
PROJECT = """
cmake_minimum_required(VERSION 3.20)
project(demo NONE)
find_package(ament_cmake_test REQUIRED)
find_package(r2bspec REQUIRED)
"""


def test_the_manifest_is_one_of_rep_149() -> None:
    parser = pytest.importorskip("catkin_pkg.package", reason="catkin_pkg is in the extra dev")
    warnings: list[str] = []
    package = parser.parse_package(str(ROOT), warnings=warnings)
    assert not warnings
    assert (package.package_format, package.get_build_type()) == (3, "ament_python")
    assert (package.name, package.version) == ("r2bspec", __version__)
    marker, *_ = (ROOT / "resource").iterdir()
    assert marker.name == package.name


def test_every_dependency_of_pip_is_one_of_rosdep_or_said_to_have_no_key() -> None:
    manifest = (ROOT / "package.xml").read_text()
    keys = set(re.findall(r"<exec_depend>python3-(.*?)(?:-pip)?</", manifest))
    lines = re.search(
        r"^dependencies = \[(.*?)^\]",
        (ROOT / "pyproject.toml").read_text(),
        re.MULTILINE | re.DOTALL,
    )
    assert lines
    names = {re.sub("^py(?=yaml)", "", name) for name in re.findall(r'"([\w-]+)', lines[1])}
    assert names - keys == {"google-re2", "mcap", "msgspec"}
    assert keys <= names
    assert all(name in manifest for name in names)


def files(folder: Path) -> set[str]:
    return {
        str(file.relative_to(folder))
        for file in folder.rglob("*")
        if file.is_file() and "__pycache__" not in file.parts
    }


def test_what_colcon_installs_is_the_whole_package(tmp_path: Path) -> None:
    pytest.importorskip("setuptools", reason="the build of colcon; it is in the extra dev")
    for name in ("setup.py", "setup.cfg", "pyproject.toml", "package.xml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tmp_path)
    for name in ("r2bspec", "docs", "cmake", "resource"):
        shutil.copytree(
            ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "*.pyc")
        )
    # The words of colcon_core/task/python/build.py, but for folders.
    words = ["setup.py", "egg_info", "--egg-base", ".", "build", "--build-base", "made", "install"]
    words += ["--root", "/", "--prefix", str(tmp_path / "there")]
    words += ["--single-version-externally-managed", "--record", "log", "install_data", "--force"]
    done = subprocess.run(
        [sys.executable, "-W", "ignore", *words],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    there = tmp_path / "there"
    (code,) = there.rglob("r2bspec/_version.py")
    assert files(code.parent) == files(tmp_path / "r2bspec")
    assert (there / "share/ament_index/resource_index/packages/r2bspec").is_file()
    assert (there / "share/r2bspec/package.xml").is_file()
    assert files(there / "share/r2bspec/docs") == files(tmp_path / "docs")
    # The command finds the pages that are installed with it.
    environment = os.environ | {"PYTHONPATH": str(code.parents[1])}
    asked = [sys.executable, str(there / "bin/r2bspec"), "docs", "--path", "ci"]
    said = subprocess.run(asked, env=environment, capture_output=True, text=True, check=False)
    assert said.stdout == f"{there}/share/r2bspec/docs/ci.md\n", said.stderr
    (points,) = there.rglob("entry_points.txt")
    assert "[ros2cli.command]\nbench = r2bspec.cli.ros2_bench:BenchCommand" in points.read_text()


def test_the_launch_test_of_the_page_starts_a_run(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[str] = []
    actions = {"ExecuteProcess": lambda cmd: started.extend(map("".join, cmd))}
    kept_alive: list[Any] = []

    def keep_alive(described: Any) -> Any:
        kept_alive.append(described)
        return described

    testing: dict[str, dict[str, Any]] = {
        "actions": {"ReadyToTest": object},
        "asserts": {},
        # Without it, launch ends with the run, and the test with "Launch stopped".
        "markers": {"keep_alive": keep_alive},
    }
    modules: dict[str, dict[str, Any]] = {
        "launch": {"LaunchDescription": list},
        "launch.actions": actions,
        "launch.substitutions": {"LaunchConfiguration": str},
        "launch_testing": {"post_shutdown_test": lambda: lambda found: found, "__path__": []},
        **{f"launch_testing.{name}": values for name, values in testing.items()},
    }
    for name, values in modules.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
        parent, _, child = name.rpartition(".")
        if parent:
            setattr(sys.modules[parent], child, module)
    namespace: dict[str, Any] = {}
    exec(page_file("ci.md", "camera_launch_test.py"), namespace)  # noqa: S102 - of the page
    namespace["generate_test_description"]()
    assert kept_alive == [namespace["generate_test_description"]]
    assert started[:2] == ["r2bspec", "run"]
    context = run_command.make_context("run", started[2:])
    assert "bench/camera.r2b.yaml" in str(context.params["specs"])
    assert "results/camera.xunit.xml" in str(context.params)


class CMake:
    """A project with tests of specs, on the ament_cmake_test that is installed."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "bench").mkdir()
        (folder / "bench" / "broken.r2b.yaml").write_text("r2bspec: 1\nname: broken\nnode: {}\n")

    def configure(self, *lines: str) -> subprocess.CompletedProcess[str]:
        (self.folder / "CMakeLists.txt").write_text("\n".join([PROJECT, *lines]))
        found = [f"-Dr2bspec_DIR={ROOT / 'cmake'}", f"-DCMAKE_PREFIX_PATH={sys.prefix}"]
        found += [f"-DR2BSPEC_EXECUTABLE={Path(sys.executable).with_name('r2bspec')}"]
        return self.run("cmake", "-S", ".", "-B", "build", *found)

    def run(self, *words: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(words, cwd=self.folder, capture_output=True, text=True, check=False)

    def results(self, target: str) -> ElementTree.Element:
        """Where `colcon test-result` looks."""
        file = self.folder / "build" / "test_results" / "demo" / f"{target}.xunit.xml"
        return ElementTree.parse(file).getroot()  # noqa: S314 - written by this test


@pytest.fixture
def cmake(tmp_path: Path) -> CMake:
    if shutil.which("cmake") is None:
        pytest.skip("no cmake is installed")
    if not (Path(sys.prefix) / "share/ament_cmake_test/cmake").is_dir():
        pytest.skip("ament_cmake_test is not installed here; it is in the extra dev")
    return CMake(tmp_path)


def test_a_spec_is_a_test_of_ament(cmake: CMake) -> None:
    (cmake.folder / "bench" / "camera.r2b.yaml").write_text("")
    done = cmake.configure(
        page_file("ci.md", "CMakeLists.txt"),
        "ament_add_r2bspec_test(bench/broken.r2b.yaml)",
        "ament_add_r2bspec_test(bench TARGET every INCONCLUSIVE skip TIMEOUT 30 ARGS --smoke)",
        "ament_add_r2bspec_test(bench TARGET later SKIP_TEST)",
    )
    assert done.returncode == 0, done.stderr
    shown = json.loads(cmake.run("ctest", "--test-dir", "build", "--show-only=json-v1").stdout)
    tests = {test["name"]: test for test in shown["tests"]}
    properties = {
        name: {each["name"]: each["value"] for each in test["properties"]}
        for name, test in tests.items()
    }
    assert all(property_["LABELS"] == ["r2bspec"] for property_ in properties.values())
    assert all(property_["RUN_SERIAL"] is True for property_ in properties.values())
    assert (properties["broken"]["TIMEOUT"], properties["every"]["TIMEOUT"]) == (600, 30)
    for name in ("camera", "every"):
        assert properties[name]["SKIP_RETURN_CODE"] == 3
    assert "SKIP_RETURN_CODE" not in properties["broken"]
    assert tests["every"]["command"][-1] == "--smoke"

    ran = cmake.run("ctest", "--test-dir", "build", "-E", "camera|every")
    assert re.search(r"broken \.+\*\*\*Failed", ran.stdout), ran.stdout
    assert re.search(r"later \.+\*\*\*Skipped", ran.stdout), ran.stdout
    (failure,) = cmake.results("broken").iter("failure")
    assert failure.get("message", "").startswith("missing-key"), failure.attrib
    assert [*cmake.results("later").iter("skipped")]


@pytest.mark.parametrize(
    ("line", "said"),
    sampled(
        [
            ("ament_add_r2bspec_test(bench/none.r2b.yaml)", "bench/none.r2b.yaml' does not exist"),
            ("ament_add_r2bspec_test(bench EVERY)", "unused arguments: EVERY"),
            ("ament_add_r2bspec_test(bench INCONCLUSIVE pass)", "is fail or skip, not 'pass'"),
        ],
        3,
    ),
    ids=repr,
)
def test_a_mistake_ends_the_configuration(cmake: CMake, line: str, said: str) -> None:
    done = cmake.configure(line)
    assert done.returncode != 0
    assert said in " ".join(done.stderr.split())
