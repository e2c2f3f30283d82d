"""What travels with a plan."""

from __future__ import annotations

from pathlib import Path

import msgspec
import yaml

from r2bspec import api
from r2bspec.fleet.archive import unpack
from r2bspec.fleet.bundle import make_bundle
from r2bspec.language.load_spec import load_spec
from r2bspec.plan.compile_plan import compile_plan
from ros_runs import Bench, relay_spec


def test_only_what_the_plan_names_travels_and_is_where_the_plan_looks_for_it(
    tmp_path: Path,
) -> None:
    folder = tmp_path / "work" / "specs"
    Bench(folder)
    for name in ("own.py", "near.py", "package/__init__.py", "package/far.py", "interfaces/x"):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text("class Own:\n    pass\n")
    (folder / "secret.txt").write_text("not to be sent")
    (folder.parent / "config").mkdir()
    (folder.parent / "config" / "relay.yaml").write_text("/**:\n  ros__parameters: {queue: 3}\n")
    (folder / "tool.sh").write_text("#!/bin/sh\n")
    spec = relay_spec(setup={"make": {"command": ["./tool.sh", "--fast"]}})
    spec["graph"]["nodes"]["own"] = {
        "python": "./own.py:Own",
        "parameters": {"model": "../config/relay.yaml"},
    }
    path = folder / "relay.r2b.yaml"
    path.write_text(yaml.safe_dump(spec))
    loaded = load_spec(path)
    assert loaded.spec is not None, loaded.diagnostics
    head = api.PreparedBenchmark(compile_plan(loaded.spec, None), folder, loaded.resolved_yaml())
    base = api.PreparedBenchmark(msgspec.structs.replace(head.plan, name="base"), folder, "")
    archive, plans = make_bundle([head, base])
    tree = tmp_path / "tree"
    unpack(archive, tree)
    names = ["own.py", "near.py", "package/__init__.py", "package/far.py", "tool.sh"]
    names += [f"bag/{file.name}" for file in (folder / "bag").iterdir()]
    expected = {str(folder / name) for name in names} | {str(folder.parent / "config/relay.yaml")}
    arrived = {str(file)[len(str(tree)) :] for file in tree.rglob("*") if file.is_file()}
    sent = {f"/{plan}" for plan in plans}
    specs = {plan.replace(".json", ".spec.yaml") for plan in sent}
    assert arrived == expected | sent | specs
    here = [api.prepare(tree / plan) for plan in plans]
    assert [side.plan for side in here] == [head.plan, base.plan]
    assert [side.spec_text for side in here] == [head.spec_text, ""]
    assert (here[0].base_dir / "../config/relay.yaml").is_file()
