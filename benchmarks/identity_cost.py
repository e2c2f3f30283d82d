"""How long it takes to identify a graph, in a workspace in colcon's layout.

::

    python benchmarks/identity_cost.py [--packages 200] [--nodes 10]

Writes a repository of so many packages of C++ and Python in equal parts, with what colcon would
have installed of them, and a plan whose nodes are programs of the first of them. Each Python
package has a node with three modules, of which one imports NumPy. Shown are the median and the
shortest time of 30 identifications in one process, none of which keeps anything for the next; files
are in the cache of the system.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import tempfile
import time
from pathlib import Path

from r2bspec.execute.identity.identify_graph import graph_identity
from r2bspec.language.quantities import Duration
from r2bspec.plan.plan import DatasetPlan, NodePlan, Plan, ProcessPlan
from r2bspec.record.graph_identity import GraphIdentity

_INDEX = "share/ament_index/resource_index/packages"
_SITE = "lib/python3/site-packages"


def write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


def write_package(top: Path, number: int) -> str:
    """Write the sources and the installation of a package; odd numbers are in Python."""
    name = f"package_{number:03d}"
    source, prefix = top / "src" / f"group_{number % 10}" / name, top / "install" / name
    manifest = f"<package><name>{name}</name><version>0.1.0</version></package>\n"
    write(source / "package.xml", manifest)
    write(prefix / "share" / name / "package.xml", manifest)
    write(prefix / _INDEX / name, "")
    program = prefix / "lib" / name / "node"
    if number % 2:
        modules = {
            "__init__.py": "",
            "node.py": f"from {name} import filters\nfrom rclpy.node import Node\n"
            + "a = 1\n" * 100,
            "filters.py": "import numpy as np\nfrom .sizes import SIZE\n" + "b = 1\n" * 100,
            "sizes.py": "SIZE = 3\n",
        }
        for module, text in modules.items():
            write(source / name / module, text)
            write(prefix / _SITE / name / module, text)
        information = prefix / _SITE / f"{name}-0.1.0-py3.12.egg-info"
        write(information / "top_level.txt", f"{name}\n")
        write(information / "entry_points.txt", f"[console_scripts]\nnode = {name}.node:main\n")
        entry = f"'{name}==0.1.0','console_scripts','node'"
        write(program, f"#!/usr/bin/python3\n# EASY-INSTALL-ENTRY-SCRIPT: {entry}\n")
    else:
        for file in ("node.cpp", "filters.cpp", "filters.hpp"):
            write(source / "src" / file, f"// {name}\n" + "int a;\n" * 200)
        write(program, "")
        program.write_bytes(Path("/bin/true").read_bytes())
    program.chmod(0o755)
    return name


def plan_of(names: list[str]) -> Plan:
    processes = tuple(
        ProcessPlan(
            name=name,
            role="command",
            phase="measure",
            argv=(f"$(executable {name} node)", "--ros-args"),
            env={},
            nodes=(
                NodePlan(
                    name=f"/{name}",
                    node=name,
                    namespace="/",
                    target="",
                    parameters={},
                    remappings={},
                ),
            ),
        )
        for name in names
    )
    return Plan(
        generator="",
        name="cost",
        title="",
        description="",
        labels={},
        namespace="/",
        environment=(),
        transport="inherit",
        largest_message_bytes=0,
        dataset=DatasetPlan(
            source="", kind="recorded", sha256="", start_ns=0, end_ns=None, topics=()
        ),
        processes=processes,
        topics=(),
        playback_mode="live",
        buffer=0,
        inputs=(),
        monitors=(),
        phases=(),
        warm_up=Duration(0),
        start_timeout=Duration(0),
        search=None,
        sustained_hz=(),
        play=(),
        objectives={},
    )


def git(top: Path, *arguments: str) -> None:
    author = ["-c", "user.name=A", "-c", "user.email=a@example.org"]
    subprocess.run(["git", *author, *arguments], cwd=top, check=True)  # noqa: S607


def main() -> None:
    """Write the workspace, identify its graph, and print the times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--packages", type=int, default=200)
    parser.add_argument("--nodes", type=int, default=10)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        top = Path(folder)
        names = [write_package(top, number) for number in range(options.packages)]
        write(top / ".gitignore", "install/\n")
        write(top / "bench" / "spec.r2b.yaml", "r2bspec: 1\n")
        git(top, "init", "-q")
        git(top, "add", "-A")
        git(top, "commit", "-q", "-m", "all")
        prefixes = [top / "install" / name for name in names]
        os.environ["AMENT_PREFIX_PATH"] = os.pathsep.join(map(str, prefixes))
        sites = [str(prefix / _SITE) for prefix in prefixes if (prefix / _SITE).is_dir()]
        os.environ["PYTHONPATH"] = os.pathsep.join(sites)
        plan = plan_of(names[: options.nodes])
        times_ms, cpu_ms = [], []
        for _ in range(31):
            began, began_cpu = time.perf_counter(), time.process_time()
            identity = graph_identity(plan, top / "bench")
            times_ms.append((time.perf_counter() - began) * 1e3)
            cpu_ms.append((time.process_time() - began_cpu) * 1e3)
        show(identity, times_ms[1:], cpu_ms[1:])


def show(identity: GraphIdentity, times_ms: list[float], cpu_ms: list[float]) -> None:
    files = sum(len(node.files) for node in identity.nodes.values())
    print(f"{len(identity.nodes)} nodes, {files} files, {len(identity.packages)} packages")  # noqa: T201
    for name, values in (("wall", times_ms), ("CPU", cpu_ms)):
        print(  # noqa: T201
            f"{name}: median {statistics.median(values):.1f} ms, shortest {min(values):.1f} ms"
        )


if __name__ == "__main__":
    main()
