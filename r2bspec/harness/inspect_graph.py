"""The nodes of the running ROS graph: ``-m r2bspec.harness.inspect_graph SECONDS FILE``.

It joins the domain of its environment, waits until discovery shows nothing new, and writes what
ROS's own interfaces tell about each node as JSON. It changes nothing in the graph.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from r2bspec.exit_status import ExitStatus
from r2bspec.harness.inspect_nodes import Inspector

_OWN_NAMESPACE = "/r2bspec"
_KEYS = ("subscribes", "publishes", "services", "qos", "parameters")


class GraphInspector(Inspector):
    """Inspects every node of the graph but its own, hidden ones and component containers.

    Args:
        timeout_s: how long to wait for the first node.
    """

    def __init__(self, timeout_s: float) -> None:
        super().__init__("", timeout_s)

    def nodes(self) -> list[dict[str, Any]]:
        """Each node with its name, namespace and interface; topics have absolute names."""
        found = []
        for name, namespace in self._wait_for_discovery():
            entry: dict[str, Any] = {key: {} for key in _KEYS}
            self._topics(name, namespace, entry)
            self._services(name, namespace, entry)
            entry["parameters"] = self._parameters(name, namespace)
            found.append({"name": name, "namespace": namespace, **entry})
        return found

    def _nodes(self) -> list[tuple[str, str]]:
        return [
            (name, namespace)
            for name, namespace in super()._nodes()
            if namespace != _OWN_NAMESPACE and not name.startswith(("_", "launch_ros_"))
        ]

    def _relative_name(self, full: str, node: str) -> str:
        del node
        return full


def main() -> int:
    """Write the nodes of the graph to a file; returns the exit status."""
    from r2bspec.harness import rclpy_tools

    timeout_s, target = float(sys.argv[1]), Path(sys.argv[2])
    try:
        found = GraphInspector(timeout_s).nodes()
        target.write_text(json.dumps(found), encoding="utf-8")
    finally:
        rclpy_tools.finish()
    return ExitStatus.OK


if __name__ == "__main__":
    sys.exit(main())
