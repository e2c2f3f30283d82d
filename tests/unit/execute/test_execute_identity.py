"""Promise: a run knows what its graph was made of, and other code has another identity."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest

from git_repositories import commit, git, write_files
from plans import node_plan, process_plan
from r2bspec.execute.identity import installed_python
from r2bspec.execute.identity.identify_graph import changes_since, graph_identity, observed_identity
from r2bspec.plan.command_lines import HARNESS_ARGV
from r2bspec.plan.plan import Plan, ProcessPlan
from r2bspec.record.graph_identity import (
    GraphIdentity,
    NodeIdentity,
    Revision,
    common_identity,
    identity_differences,
)
from run_simulation import Simulation

EMPTY = msgspec.structs.replace(Simulation().plan(), topics=(), inputs=(), monitors=())
NODE = "from rclpy.node import Node\n\n\nclass Blur(Node):\n    pass\n"


def plan_of(*processes: ProcessPlan, **fields: Any) -> Plan:
    return msgspec.structs.replace(EMPTY, processes=processes, **fields)


def process_of(name: str, *argv: str, role: str = "command", **node: Any) -> ProcessPlan:
    """A process with one node, of which `node` says more."""
    return process_plan(name, role, argv=argv, nodes=(node_plan(name, namespace="/", **node),))


def python_process(name: str, target: str, **fields: Any) -> ProcessPlan:
    return process_of(name, *HARNESS_ARGV, role="host", target=target, **fields)


def only_node(identity: GraphIdentity) -> NodeIdentity:
    (node,) = identity.nodes.values()
    return node


def paths(node: NodeIdentity) -> list[str]:
    return [file.path for file in node.files]


@pytest.fixture(autouse=True)
def _no_workspace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", "/dev/null")
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.delenv("PYTHONPATH", raising=False)


@pytest.fixture(name="top")
def new_work_tree(tmp_path: Path) -> Path:
    """A work tree with a node in a folder, a helper that it imports, and one that it does not."""
    top = tmp_path / "work tree"
    files = {
        "bench/blur.r2b.yaml": "r2bspec: 1\n",
        "nodes/blur.py": f"import json\nimport helper\nfrom shapes.box import Box\n{NODE}",
        "nodes/helper.py": "WEIGHT = 1\n",
        "nodes/unused.py": "UNUSED = 1\n",
        "nodes/shapes/__init__.py": "",
        "nodes/shapes/box.py": "from .corner import Corner\nBox = 1\n",
        "nodes/shapes/corner.py": "Corner = 1\n",
    }
    commit(top, files)
    return top


BLUR = plan_of(python_process("blur", "../nodes/blur.py:Blur"))


def identity_of(top: Path, plan: Plan = BLUR) -> GraphIdentity:
    return graph_identity(plan, top / "bench")


def differences_by(
    top: Path, folder: Path, files: dict[str, str], plan: Plan = BLUR
) -> tuple[str, ...]:
    """What another content of some files changes."""
    before = identity_of(top, plan)
    write_files(folder, files)
    return identity_differences(before, identity_of(top, plan))


@pytest.mark.parametrize("name", ["blur.py", "helper.py", "shapes/corner.py"])
def test_a_change_of_a_loaded_file_is_another_identity_and_is_named(top: Path, name: str) -> None:
    loaded = [f"nodes/{each}" for each in ("blur.py", "helper.py", "shapes/corner.py")]
    before = observed(top, *loaded)
    write_files(top / "nodes", {name: (top / "nodes" / name).read_text() + "# changed\n"})
    changes = identity_differences(before, observed(top, *loaded))
    assert changes == (f"{Path(name).name} changed",)


def test_the_digest_does_not_depend_on_the_place_of_the_work_tree(
    top: Path, tmp_path: Path
) -> None:
    linked = tmp_path / "linked"
    git(top, "worktree", "add", "-q", "--detach", str(linked))
    base = graph_identity(BLUR, linked / "bench", revision=Revision("c" * 40, dirty=False))
    assert base.digest == identity_of(top).digest
    assert base.revision == Revision("c" * 40, dirty=False)
    assert paths(only_node(base)) == paths(only_node(identity_of(top)))


def test_nothing_is_executed(top: Path, tmp_path: Path) -> None:
    mark = tmp_path / "executed"
    guard = f"open({str(mark)!r}, 'w')\n"
    write_files(top, {"nodes/blur.py": guard + NODE, "nodes/helper.py": guard})
    program = top / "bench" / "program.sh"
    program.write_text(f"#!/bin/sh\necho > '{mark}'\n")
    program.chmod(0o755)
    plan = plan_of(
        python_process("blur", "../nodes/blur.py:Blur"), process_of("program", "./program.sh")
    )
    assert {*identity_of(top, plan).nodes} == {"blur", "program"}
    assert not mark.exists()


# Revision


def test_a_clean_a_dirty_and_no_work_tree(top: Path, tmp_path: Path) -> None:
    revision = Revision(git(top, "rev-parse", "HEAD"), dirty=False)
    assert identity_of(top).revision == revision
    write_files(top, {"untracked.txt": ""})
    assert identity_of(top).revision == revision
    write_files(top, {"nodes/unused.py": "UNUSED = 3\n"})
    assert identity_of(top).revision == msgspec.structs.replace(revision, dirty=True)
    write_files(tmp_path / "outside", {"blur.py": NODE})
    plan = plan_of(python_process("blur", "./blur.py:Blur"))
    outside = graph_identity(plan, tmp_path / "outside")
    assert outside.revision is None
    assert paths(only_node(outside)) == ["blur.py"]


# Installed modules and distributions


def install(folder: Path, name: str, version: str, module: str = "") -> None:
    module = module or name
    write_files(
        folder,
        {
            f"{module}/__init__.py": f"VERSION = {version!r}\n",
            f"{name}-{version}.dist-info/METADATA": f"Name: {name}\nVersion: {version}\n\n",
            f"{name}-{version}.dist-info/RECORD": f"{module}/__init__.py,,\n",
        },
    )


@pytest.fixture(name="installed")
def new_installation(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "environment" / "site-packages"
    folder.mkdir(parents=True)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return folder


def observed(top: Path, *names: str, plan: Plan = BLUR) -> GraphIdentity:
    """The identity after a run whose only process has loaded these files."""
    identity = identity_of(top, plan)
    loaded = {plan.processes[0].name: [str(top / name) for name in names]}
    return observed_identity(identity, plan, top / "bench", loaded)


def test_after_a_run_a_node_is_known_by_what_its_process_has_loaded(
    top: Path, installed: Path
) -> None:
    install(installed, "fast_filters", "1.0", module="filters")
    library = top.parent / "elsewhere" / "libown.so"
    library.parent.mkdir()
    library.write_bytes(b"\x7fELF1")
    files = ("nodes/blur.py", "nodes/helper.py", "build/libbuilt.so", "gone.py")
    write_files(top, {"build/libbuilt.so": "built in the work tree"})
    loaded = (*files, str(installed / "filters/__init__.py"), str(library), sys.executable)
    before = observed(top, *loaded)
    assert paths(only_node(before)) == [str(library), "nodes/blur.py", "nodes/helper.py"]
    assert before.packages["fast-filters"] == "1.0"
    assert changes_since(before, top / "bench", is_elsewhere=False) == []
    commit(top, {"nodes/unused.py": "UNUSED = 2\n", "README.md": "text"})
    after = observed(top, *loaded)
    assert after.digest == before.digest
    assert after.revision != before.revision
    assert identity_differences(before, after) == ()
    shutil.rmtree(installed / "fast_filters-1.0.dist-info")
    installed_python._owners.cache_clear()
    install(installed, "fast_filters", "1.1", module="filters")
    write_files(top, {"nodes/helper.py": "HELP = 2\n"})
    library.unlink()
    expected = ("fast-filters 1.0 → 1.1", "helper.py changed", "libown.so removed")
    changes = changes_since(before, top / "bench", is_elsewhere=False)
    assert sorted(changes) == sorted(expected)
    assert changes_since(before, top / "bench", is_elsewhere=True) == ["helper.py changed"]
    differences = identity_differences(before, observed(top, *loaded))
    assert sorted(differences) == sorted(expected)


def test_starts_that_load_different_files_of_the_same_code_have_one_identity(top: Path) -> None:
    first = observed(top, "nodes/blur.py")
    second = observed(top, "nodes/blur.py", "nodes/helper.py")
    both = common_identity([first, second])
    assert both is not None
    assert both.digest == second.digest
    write_files(top, {"nodes/blur.py": "OTHER = 1\n"})
    assert common_identity([first, observed(top, "nodes/blur.py")]) is None
    assert common_identity([first, None]) is None


# Executables, components, commands and launch files


class Workspace:
    """A workspace in colcon's layout, with an installation of what it has."""

    def __init__(self, top: Path) -> None:
        self.top = top
        self.install = top / "install"

    def package(self, name: str, depends: str = "", version: str = "0.1.0") -> Path:
        prefix = self.install / name
        dependency = f"<depend>{depends}</depend>" if depends else ""
        manifest = f"<package><name>{name}</name><version>{version}</version>{dependency}</package>"
        index = "share/ament_index/resource_index/packages"
        write_files(prefix, {f"{index}/{name}": "", f"share/{name}/package.xml": manifest})
        write_files(self.top / "src" / name, {"package.xml": manifest})
        return prefix


@pytest.fixture(name="workspace")
def new_workspace(top: Path, monkeypatch: pytest.MonkeyPatch) -> Workspace:
    prefixes = [top / "install" / package for package in ("core", "lens")]
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(map(str, prefixes)))
    monkeypatch.setenv("PYTHONPATH", str(top / "install/lens/lib/python3/site-packages"))
    return Workspace(top)


def write_program(path: Path, content: bytes) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
    path.chmod(0o755)


def test_an_executable_of_the_work_tree_is_known_by_the_sources_of_its_package(
    top: Path, workspace: Workspace
) -> None:
    prefix = workspace.package("lens", depends="core")
    workspace.package("core")
    write_program(prefix / "lib/lens/blur_node", b"\x7fELF1")
    sources = {"lens/src/blur.cpp": "int a;", "core/src/core.cpp": "int b;"}
    tests = {"lens/test/test_blur.cpp": "int t;", "lens/README.md": "text"}
    write_files(top / "src", sources | tests)
    plan = plan_of(process_of("blur", "$(executable lens blur_node)"))
    node = only_node(identity_of(top, plan))
    assert (node.kind, node.package, node.version) == ("executable", "lens", "0.1.0")
    assert paths(node) == [
        "src/core/package.xml",
        "src/core/src/core.cpp",
        "src/lens/package.xml",
        "src/lens/src/blur.cpp",
    ]
    core = {"core/src/core.cpp": "int c;"}
    assert differences_by(top, top / "src", core, plan) == ("core.cpp changed",)
    # What is built differs with the place of the build.
    after = identity_of(top, plan)
    write_program(prefix / "lib/lens/blur_node", b"\x7fELF2")
    assert identity_differences(after, identity_of(top, plan)) == ()


@pytest.mark.parametrize("links", [False, True])
def test_a_python_executable_of_a_workspace_is_known_by_the_modules_that_it_imports(
    top: Path, workspace: Workspace, *, links: bool
) -> None:
    prefix = workspace.package("lens")
    sources = top / "src" / "lens" / "lens"
    write_files(sources, {"blur.py": "from lens import kernel\n", "kernel.py": "K=1"})
    site = prefix / "lib/python3/site-packages"
    site.mkdir(parents=True)
    if links:
        (site / "lens").symlink_to(sources)
    else:
        shutil.copytree(sources, site / "lens")
    plan = plan_of(process_of("blur", "$(executable lens blur_node)"))
    loaded = [str(site / "lens" / name) for name in ("blur.py", "kernel.py")]
    before = observed(top, *loaded, plan=plan)
    names = [f"src/lens/{name}" for name in ("lens/blur.py", "lens/kernel.py", "package.xml")]
    copies = () if links else [str(Path(file).relative_to(top)) for file in loaded]
    assert paths(only_node(before)) == [*copies, *names]
    write_files(sources, {"kernel.py": "K=2"})
    changed = identity_differences(before, observed(top, *loaded, plan=plan))
    assert changed == ("kernel.py changed",)


def test_a_command_is_known_by_the_files_of_the_work_tree_that_it_names(top: Path) -> None:
    write_files(top, {"bench/tool.py": "", "bench/map.yaml": "a"})
    plan = plan_of(process_of("tool", "python3", "./tool.py", "--map:=map.yaml", "missing.yaml"))
    node = only_node(identity_of(top, plan))
    assert node.kind == "command"
    assert paths(node) == ["bench/map.yaml", "bench/tool.py"]
    assert differences_by(top, top, {"bench/map.yaml": "b"}, plan) == ("map.yaml changed",)


def test_parameter_files_count_for_every_kind_of_node(top: Path) -> None:
    write_files(top, {"bench/params.yaml": "/**: {ros__parameters: {a: 1}}\n"})
    plan = plan_of(
        python_process("blur", "../nodes/blur.py:Blur", parameter_files=("params.yaml",))
    )
    assert "bench/params.yaml" in paths(only_node(identity_of(top, plan)))
    other = {"bench/params.yaml": "/**: {ros__parameters: {a: 2}}\n"}
    assert differences_by(top, top, other, plan) == ("params.yaml changed",)


def test_a_launch_file_counts_and_says_that_there_is_more(top: Path) -> None:
    write_files(top, {"bench/blur.launch.py": "a = 1\n"})
    launched = ("$(included_launch)", "file:=./blur.launch.py", "namespace:=/")
    plan = plan_of(process_of("blur", "ros2", "launch", *launched))
    node = only_node(identity_of(top, plan))
    assert (node.kind, paths(node)) == ("launch", ["bench/blur.launch.py"])
    assert "when it is executed" in node.unknown
    changed = {"bench/blur.launch.py": "a = 2\n"}
    assert differences_by(top, top, changed, plan) == ("blur.launch.py changed",)
