"""What every test starts from, and what several of them share."""

from __future__ import annotations

import compileall
import gc
import os
import signal
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

from nightly import NIGHTLY

if TYPE_CHECKING:
    from r2bspec.bags.recording import SyntheticDataset

pytest_plugins = ["command_line", "family_trees", "reported_runs"]

# A first example that imports or compiles something, on a busy machine, is no failure. Others than
# the same examples are drawn by `make nightly`: a search may find an old defect in any change.
settings.register_profile("r2bspec", settings(), deadline=None, derandomize=not NIGHTLY)
settings.load_profile("r2bspec")


# Tests are compiled once, and r2bspec before a thousand programs import it; what they import
# besides, and whether they keep it, is as the tester has it.
_KEEPS_NO_BYTECODE = sys.dont_write_bytecode
sys.dont_write_bytecode = False
if "PYTEST_XDIST_WORKER" not in os.environ:
    compileall.compile_dir(Path(__file__).parents[1] / "r2bspec", quiet=1)

_UNIT = Path(__file__).with_name("unit")
_LONGEST = frozenset(
    f"test_{name}.py"
    for name in (
        *("ros_merge_gate", "ros_diagnosis", "ros_tune", "ros_anatomy", "ros_truth"),
        *("ros_turns", "fleet_runs", "ros_tutorial", "fault_interruption", "ros_relay_run"),
    )
)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, so that none of them ends alone; the others mixed.

    Tests on real ROS 2 wait for a third of their time, in which others can compute.
    """
    items.sort(
        key=lambda item: (item.path.name not in _LONGEST, zlib.crc32(item.path.name.encode()))
    )


def pytest_collection_finish() -> None:
    """Collected tests stay until the end, thousands of them: a search for garbage passes by."""
    sys.dont_write_bytecode = _KEEPS_NO_BYTECODE
    gc.collect()
    gc.freeze()


def pytest_configure() -> None:
    """Let signals do what they usually do.

    Under nohup, and in a background job of a shell, they are ignored, by children of the tests as
    well: r2bspec respects that, and what is promised of them could not be seen.
    """
    # Tests make runs at the same time, on purpose; those of the lock have a lock of their own.
    os.environ["R2BSPEC_NO_LOCK"] = "1"
    # Output is plainer and rarer in a CI job; tests of that set the variable themselves.
    os.environ.pop("CI", None)
    # A simulated run is a dozen files, and no test looks at what survives a power cut.
    pytest.MonkeyPatch().setattr(os, "fsync", lambda _descriptor: None)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, signal.SIG_DFL)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print the figure of each simulation, which says more than that it suffices."""
    for report in terminalreporter.stats.get("passed", []):
        for name, value in report.user_properties:
            if name == "figure":
                terminalreporter.write_line(f"{report.nodeid}: {value}")


@pytest.fixture(autouse=True)
def nothing_left(request: pytest.FixtureRequest) -> Iterator[None]:
    """No process and no shared memory of a real run stays, whatever the test has done.

    Unit tests write the folders of runs at most: all processes of the machine are not looked
    through after each of thousands.
    """
    yield
    if (runs := sys.modules.get("ros_runs")) is not None and _UNIT not in request.path.parents:
        runs.assert_nothing_left()


@pytest.fixture(autouse=True)
def no_real_datasets(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tester's own datasets must not change what names mean."""
    monkeypatch.delenv("R2B_DATASETS", raising=False)


@pytest.fixture(autouse=True)
def default_middleware(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor must the one that the tester uses for other work."""
    monkeypatch.delenv("RMW_IMPLEMENTATION", raising=False)


@pytest.fixture(scope="session")
def storage_room(tmp_path_factory: pytest.TempPathFactory) -> SyntheticDataset:
    """A short stretch of r2b_storage with every topic, made once for all workers."""
    from data_bags import WINDOW
    from r2bspec.datasets.synthesis import make

    folder = tmp_path_factory.getbasetemp()
    folder = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    return make("r2b_storage", None, WINDOW, cache_dir=folder / "datasets")


@pytest.fixture
def real_bags() -> Path:
    """Folder of recordings that others made."""
    folder = os.environ.get("R2BSPEC_TEST_BAGS", "")
    if not folder:
        pytest.skip("R2BSPEC_TEST_BAGS names no folder")
    return Path(folder)
