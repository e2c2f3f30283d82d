"""The environment of every process of a run: what is inherited, and what the run adds.

Only variables that running ROS programs need are inherited. Secrets that a CI system keeps in
the environment therefore never reach a node, unless the spec names them under ``environment:``.
"""

from __future__ import annotations

import fnmatch
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from types import MappingProxyType

from r2bspec.execute.processes.secret_references import SecretReferences
from r2bspec.ipc.protocol import MODULES_FOLDER_VARIABLE, RUN_ID_VARIABLE
from r2bspec.middleware.middleware import Transport
from r2bspec.middleware.rmw_registry import inherited_variables, middleware_of
from r2bspec.plan.plan import Plan

_INHERITED_PATTERNS = (
    *("PATH", "HOME", "USER", "LOGNAME", "SHELL", "LANG", "LC_*", "TZ", "TMPDIR", "TERM"),
    *("PYTHON*", "VIRTUAL_ENV", "CONDA_PREFIX", "LD_LIBRARY_PATH", "LD_PRELOAD", "XDG_*"),
    *("ROS_*", "_ROS_*", "AMENT_*", "COLCON_*", "CMAKE_PREFIX_PATH", "RMW_*", "RCUTILS_*", "RCL_*"),
    "R2B_DATASETS",
    *("CUDA_*", "NVIDIA_*", "HIP_*", "ROCR_*", "HSA_*", "LIBGL_*", "VK_*", "__GLX_*", "__NV_*"),
    *("OMP_*", "KMP_*", "MKL_*", "OPENBLAS_*", "OPENCV_*", "TBB_*", "MALLOC_*", "GLIBC_TUNABLES"),
    *("DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "QT_*", "GZ_*", "COVERAGE_*"),
)

MODULES_FOLDER = "modules"
"""In the scratch folder of a run: what programs of Python nodes have imported, by process."""

_HARNESS_ALLOCATOR = {
    # glibc gives every large buffer back to the kernel and faults it in again for the next
    # message; keeping them saves three quarters of the time of a raw receive of an image.
    "MALLOC_MMAP_MAX_": "0",
    "MALLOC_TRIM_THRESHOLD_": str(1 << 30),
    "MALLOC_TOP_PAD_": str(64 << 20),
    # Buffers in huge pages, where the kernel gives them to those who ask: copying an image touches
    # a thousand small ones.
    "GLIBC_TUNABLES": "glibc.malloc.hugetlb=1",
}


def inherited_environment(environ: Mapping[str, str], named: Iterable[str]) -> dict[str, str]:
    """The part of an environment that processes of a run get."""
    names = frozenset(named)
    wildcards = (name for name in names if set(name) & set("*?["))
    patterns = (*_INHERITED_PATTERNS, *inherited_variables(), *wildcards)
    return {
        name: value
        for name, value in environ.items()
        if name in names or any(fnmatch.fnmatchcase(name, pattern) for pattern in patterns)
    }


class RunEnvironment:
    """The environments of one run's processes.

    Attributes:
        secrets: the values that commands, variables and parameters of the plan refer to.
        middleware: which one the processes load.
        transport: how their messages travel.
        segment_bytes: the shared memory that each process takes when it starts; 0 where that is
            not for the run to decide.
    """

    def __init__(
        self,
        plan: Plan,
        *,
        run_id: str,
        domain: int,
        scratch: Path,
        largest_message_bytes: int,
        ros_logs: Path | None = None,
    ) -> None:
        self.secrets = SecretReferences(plan.environment, os.environ)
        self._common = inherited_environment(os.environ, plan.environment)
        if path := self._common.get("PYTHONPATH"):
            # Processes run in the folder of the spec; the user means where they are themselves.
            # An empty entry, which a colon too many makes, would be the current folder to Python:
            # what lies there, a stranger's checkout perhaps, must not shadow modules.
            folders = (str(Path(each).absolute()) for each in path.split(os.pathsep) if each)
            self._common["PYTHONPATH"] = os.pathsep.join(folders)
        self._common |= {
            RUN_ID_VARIABLE: run_id,
            MODULES_FOLDER_VARIABLE: str(scratch / MODULES_FOLDER),
            "ROS_DOMAIN_ID": str(domain),
            "PYTHONUNBUFFERED": "1",
            # Otherwise ROS leaves a file for each process in the user's home.
            "ROS_LOG_DIR": str(ros_logs or scratch / "ros_logs"),
        }
        self.middleware = middleware_of(self._common)
        for name in self.middleware.removed_variables:
            self._common.pop(name, None)
        self.transport = Transport(plan.transport, largest_message_bytes, plan.segment_bytes)
        self._common |= self.middleware.configure(self.transport, scratch)
        self.segment_bytes = self.middleware.segment_bytes(self.transport)

    def is_same_as(self, other: RunEnvironment) -> bool:
        """Whether processes get the same variables; what the files that these name say may differ.

        The middleware reads its files when a process initialises ROS, not before.
        """
        return self._common == other._common

    def for_harness(self, changes: Mapping[str, str] = MappingProxyType({})) -> dict[str, str]:
        """The environment of loader, player and monitor, and of nodes in the same process."""
        return self._common | _HARNESS_ALLOCATOR | self.secrets.in_environment(changes)

    def for_node(self, changes: Mapping[str, str]) -> dict[str, str]:
        """The environment of a process that runs nodes: nothing but what the plan states."""
        return self._common | self.secrets.in_environment(changes)
