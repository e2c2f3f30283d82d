"""What leads to the code of the head leads to that of the base, or is refused."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import r2bspec
from git_repositories import write_files
from r2bspec.compare.base_environment import (
    SEARCH_PATHS,
    BaseBuildError,
    BaseBuilds,
    base_environment,
    is_code_of,
)
from r2bspec.compare.base_tree import BaseRevisionError, BaseTree
from r2bspec.execute.processes.environment import applied_environment
from r2bspec.execute.states import Progress
from r2bspec.language.quantities import Duration
from r2bspec.language.spec import GateBase
from r2bspec.plan.this_machine import find_module
from r2bspec.record.graph_identity import Revision

PACKAGE = {"src/pkg/pkg/__init__.py": "", "src/pkg/pkg/node.py": "SIDE = 0\n"}


def base_tree(top: Path, head_top: Path) -> BaseTree:
    revision = Revision(commit="1234567", dirty=False, name="main")
    return BaseTree(top, head_top, "main@1234567", revision, files={})


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> BaseTree:
    for side in ("ws/src/head", "base"):
        write_files(tmp_path / side, PACKAGE)
    for name in SEARCH_PATHS:
        if name != "PATH":
            monkeypatch.delenv(name, raising=False)
    return base_tree(tmp_path / "base", tmp_path / "ws/src/head")


def test_entries_of_search_paths_become_those_of_the_base(
    tree: BaseTree, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tree.head_top / "untracked").mkdir()
    entries = [tree.head_top / "src/pkg", Path("/opt/other"), tree.head_top / "untracked"]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(map(str, entries)))
    changes = base_environment(tree, built=False)
    assert changes == {"PYTHONPATH": f"{tree.top / 'src/pkg'}{os.pathsep}/opt/other"}
    with applied_environment(changes):
        found = find_module("pkg.node")
        assert found is not None
        assert found.origin == str(tree.top / "src/pkg/pkg/node.py")
    assert str(tree.top / "src/pkg") not in sys.path


def test_links_into_the_tree_of_the_head_are_seen(
    tree: BaseTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "link").symlink_to(tree.head_top / "src")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "link/pkg"))
    assert base_environment(tree, built=False) == {"PYTHONPATH": str(tree.top / "src/pkg")}


@pytest.mark.parametrize("way", ["pth", "finder"])
def test_an_editable_package_of_the_head_is_found_in_the_base(
    tree: BaseTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    site = tmp_path / "site"
    site.mkdir()
    place = tree.head_top / "src/pkg"
    if way == "pth":
        (site / "__editable__.pkg.pth").write_text(f"import evil\n{place}\n")
    else:
        mapping = {"pkg": str(place / "pkg")}
        (site / "__editable___pkg_1_0_finder.py").write_text(
            f"MAPPING: dict[str, str] = {mapping!r}\nopen('/nonexistent/x')\n"
        )
    monkeypatch.syspath_prepend(str(site))
    assert base_environment(tree, built=False) == {"PYTHONPATH": str(tree.top / "src/pkg")}


def test_a_copy_that_was_installed_from_the_head_is_refused_unless_the_base_is_built(
    tree: BaseTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    info = tmp_path / "site" / "pkg-1.0.dist-info"
    url = {"url": (tree.head_top / "src/pkg").as_uri(), "dir_info": {}}
    write_files(info, {"METADATA": "Name: pkg\nVersion: 1.0\n", "direct_url.json": json.dumps(url)})
    monkeypatch.syspath_prepend(str(info.parent))
    with pytest.raises(BaseRevisionError, match="the package pkg was installed") as caught:
        base_environment(tree, built=False)
    assert "gate.base" in caught.value.hint
    assert base_environment(tree, built=True) == {}


def test_an_overlay_of_the_workspace_of_the_head_is_refused_unless_the_base_is_built(
    tree: BaseTree, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    install = tmp_path / "ws/install"
    write_files(install, {".colcon_install_layout": "isolated", "pkg/lib/x": ""})
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{install / 'pkg'}:/opt/ros/jazzy")
    with pytest.raises(BaseRevisionError, match="the overlay"):
        base_environment(tree, built=False)
    assert base_environment(tree, built=True) == {"AMENT_PREFIX_PATH": "/opt/ros/jazzy"}


def test_an_overlay_in_the_tree_of_the_head_becomes_that_of_the_base(
    tree: BaseTree, monkeypatch: pytest.MonkeyPatch
) -> None:
    layout = {"install/.colcon_install_layout": "isolated", "install/pkg/lib/x": ""}
    write_files(tree.head_top, layout)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tree.head_top / "install/pkg"))
    assert base_environment(tree, built=False) == {"AMENT_PREFIX_PATH": ""}
    write_files(tree.top, layout)
    mapped = str(tree.top / "install/pkg")
    assert base_environment(tree, built=False) == {"AMENT_PREFIX_PATH": mapped}


def test_a_virtual_environment_in_the_tree_and_r2bspec_serve_both_sides(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    head = tmp_path / "head"
    environment = head / ".venv"
    (environment / "bin").mkdir(parents=True)
    tree = base_tree(tmp_path / "base", head)
    monkeypatch.setattr(sys, "prefix", str(environment))
    monkeypatch.setenv("PATH", f"{environment / 'bin'}:/usr/bin")
    assert "PATH" not in base_environment(tree, built=False)
    assert not is_code_of(environment / "lib/x.py", tree, "head")
    assert is_code_of(head / "x.py", tree, "head")
    own = Path(r2bspec.__file__).resolve().parent
    tree = base_tree(tmp_path / "base", own.parent)
    assert not is_code_of(own / "api.py", tree, "head")
    assert is_code_of(own.parent / "specs/x.py", tree, "head")
    assert "PYTHONPATH" not in base_environment(tree, built=False)


def test_a_base_in_the_tree_of_the_head_is_not_the_head(tmp_path: Path) -> None:
    tree = base_tree(tmp_path / "base", tmp_path)
    assert not is_code_of(tmp_path / "base/x.py", tree, "head")
    assert is_code_of(tmp_path / "base/x.py", tree, "base")


class TestBuilds:
    def test_the_base_is_built_in_its_tree_and_its_setup_is_sourced(self, tree: BaseTree) -> None:
        script = "mkdir install && echo 'export PYTHONPATH=/built:$PYTHONPATH' > install/setup.bash"
        settings = GateBase(build=(("sh", "-c", script),), setup="install/setup.bash")
        builds = BaseBuilds(tree)
        found = builds.environment(settings, Progress())
        assert found["PYTHONPATH"].startswith("/built:")
        # A second spec with the same settings builds nothing again: mkdir would fail.
        assert builds.environment(settings, Progress()) is found

    def test_a_build_sees_no_search_path_of_the_head(
        self, tree: BaseTree, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setenv("PYTHONPATH", str(tree.head_top / "src/pkg"))
        command = ("python3", "-c", "import pkg; print(pkg.__file__, file=open('seen', 'w'))")
        BaseBuilds(tree).environment(GateBase(build=(command,)), Progress())
        seen = (tree.top / "seen").read_text().strip()
        assert seen == str(tree.top / "src/pkg/pkg/__init__.py")

    @pytest.mark.parametrize(
        ("setup", "variable", "value"),
        [
            ("PYTHONPATH=build", "PYTHONPATH", "{top}/build"),
            ("OMP_NUM_THREADS=3", "OMP_NUM_THREADS", "3"),
        ],
    )
    def test_a_setup_can_be_a_variable(
        self, tree: BaseTree, setup: str, variable: str, value: str
    ) -> None:
        found = BaseBuilds(tree).environment(GateBase(setup=setup), Progress())
        assert found[variable] == value.format(top=tree.top)

    def test_a_build_that_fails_says_how_and_names_the_way_out(self, tree: BaseTree) -> None:
        command = ("sh", "-c", "echo first; echo 'x.cpp:3: error' >&2; exit 3")
        with pytest.raises(BaseBuildError, match=r"(?s)ended with 3.*x\.cpp:3: error") as caught:
            BaseBuilds(tree).environment(GateBase(build=(command,)), Progress())
        assert "--allow base" in caught.value.hint

    def test_a_program_that_is_missing(self, tree: BaseTree) -> None:
        with pytest.raises(BaseBuildError, match="cannot be started"):
            BaseBuilds(tree).environment(GateBase(build=(("no-such",),)), Progress())

    def test_a_build_that_takes_too_long_is_ended_with_all_its_processes(
        self, tree: BaseTree
    ) -> None:
        command = ("sh", "-c", "sleep 600 & echo $! > child; wait")
        settings = GateBase(build=(command,), timeout=Duration(2_000_000_000))
        with pytest.raises(BaseBuildError, match="did not end within 2 s"):
            BaseBuilds(tree).environment(settings, Progress())
        child = (tree.top / "child").read_text().strip()
        state = subprocess.run(
            ["ps", "-o", "stat=", "-p", child],  # noqa: S607
            capture_output=True,
            text=True,
            check=False,
        ).stdout
        assert state.strip()[:1] in {"", "Z"}
