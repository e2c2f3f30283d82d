"""What takes long to import is imported where it is needed, and not before."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]
ROS = ("rclpy", "cv2", "numpy")
LIBRARIES = (*ROS, "scipy", "rosbags", "rich", "psutil", "networkx", "r2bspec.nodes")
EXPLAINERS = ("jsonschema", "r2bspec.language.explain_violations")
STAGES = ("r2bspec.language", "r2bspec.check", "r2bspec.plan", "r2bspec.diagnostics")
REPORTS = ("matplotlib", "jinja2", "scipy", "mcap", "junitparser", "rich")
LOAD = "from pathlib import Path; from r2bspec.language.load_spec import load_spec; load_spec(Path"
MAIN = "from r2bspec.cli.main import main; main"
GOLDEN = ROOT / "tests" / "golden" / "language"


@pytest.mark.parametrize(
    ("code", "heavy"),
    [
        (f"{LOAD}('{GOLDEN}/ok_full.yaml'))", LIBRARIES),
        (f"{LOAD}('{GOLDEN}/ok_everything.yaml'), environ={{'R2B_TEST_COUNT': '7'}})", EXPLAINERS),
        (f"{MAIN}(['validate', '{ROOT}/specs/*.r2b.yaml'])", LIBRARIES),
        (f"{MAIN}(['validate', '{GOLDEN}/version.yaml'])", (*LIBRARIES, "r2bspec.check")),
        ("import r2bspec", STAGES),
        (
            (
                "from r2bspec.report.format_registry import FORMATS, check_installed;"
                "[check_installed(name) for name in FORMATS]"
            ),
            REPORTS,
        ),
        ("import r2bspec.doctor.all_checks", ROS),
        ("import r2bspec.nodes; dir(r2bspec.nodes)", ROS),
    ],
    ids=[
        *("load", "load without mistakes", "validate", "a document with an error", "the package"),
        *("formats", "doctor", "nodes"),
    ],
)
def test_nothing_heavy_is_imported(code: str, heavy: tuple[str, ...]) -> None:
    program = f"import sys; {code}; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "[]"
