"""A real run knows what its graph was made of, and which files its processes have loaded."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from git_repositories import commit, git
from r2bspec.record.run_folder import read_loaded_files
from ros_runs import IMAGE, Bench, relay_spec

NODE = """
import gains


class Brightness(Node):
    def __init__(self, **kwargs):
        super().__init__("brightness", **kwargs)
        self.publisher = self.create_publisher(Image, "output", 10)
        self.create_subscription(Image, "input", self.on_image, 10)

    def on_image(self, message):
        import later
        self.publisher.publish(message)
"""


def test_a_run_names_its_sources_its_revision_and_what_was_loaded(tmp_path: Path) -> None:
    bench = Bench(tmp_path / "repository")
    bench.write_node("brightness.py", NODE)
    (bench.folder / "gains.py").write_text("GAIN = 2\n")
    (bench.folder / "later.py").write_text("")
    (bench.folder / "unused.py").write_text("")
    commit(bench.folder)
    spec = relay_spec(
        graph={"nodes": {"brightness": {"python": "./brightness.py:Brightness"}}},
        monitors={"out": {"topic": "output", "format": IMAGE}},
    )

    done = bench.run(spec)
    done.assert_complete()
    record = done.run().record
    assert record.identity is not None
    assert record.identity.revision is not None
    assert record.identity.revision.commit == git(bench.folder, "rev-parse", "HEAD")
    assert not record.identity.revision.dirty
    node = record.identity.nodes["brightness"]
    assert [file.path for file in node.files] == ["brightness.py", "gains.py", "later.py"]
    assert done.result()["identity"]["digest"] == record.identity.digest
    assert f"revision {record.identity.revision.commit[:7]}" in done.stdout

    loaded = read_loaded_files(done.folder)
    assert [*loaded] == ["brightness"]
    # The last one is imported by the first message, long after the node was ready.
    names = {Path(file).name for file in loaded["brightness"] if file.startswith(str(tmp_path))}
    assert names == {"brightness.py", "gains.py", "later.py"}
    assert any("rclpy" in file for file in loaded["brightness"])
    assert any(".so" in Path(file).name for file in loaded["brightness"])
