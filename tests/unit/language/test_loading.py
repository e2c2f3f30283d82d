"""What `load_spec` gives, and what it imports."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from r2bspec.language.load_spec import load_spec
from r2bspec.language.spec import BagSource

# What `load_spec` gives.


GOLDEN = Path(__file__).parents[2] / "golden" / "language"
ENVIRON = {"R2B_TEST_DATA": "/data"}


def test_a_bag_as_one_word() -> None:
    content = (GOLDEN / "ok_minimal.yaml").read_text()
    for written, source in {
        "r2b_storage": BagSource(dataset="r2b_storage"),
        "kitchen.mcap": BagSource(dataset="kitchen.mcap"),
        "./kitchen": BagSource(path="./kitchen"),
        "bags/kitchen": BagSource(path="bags/kitchen"),
        "..": BagSource(path=".."),
        "{path: kitchen}": BagSource(path="kitchen"),
    }.items():
        spec = load_spec(content.replace("r2b_storage", written)).spec
        assert spec is not None
        assert spec.data_loader.bag == source


def test_where_a_text_and_a_file_stand(tmp_path: Path) -> None:
    file = tmp_path / "a.r2b.yaml"
    file.write_bytes((GOLDEN / "ok_minimal.yaml").read_bytes())
    loaded = load_spec(file)
    assert (loaded.file, loaded.base_dir) == (str(file), tmp_path)
    text = load_spec("x: 1", file="specs/b.r2b.yaml")
    assert (text.file, text.base_dir) == ("specs/b.r2b.yaml", Path("specs"))
    assert text.span(("x",)).file == "specs/b.r2b.yaml"
    assert text.texts == {"specs/b.r2b.yaml": "x: 1"}


def test_the_same_words_in_every_process() -> None:
    code = (
        "import sys; from pathlib import Path; from r2bspec.language.load_spec import load_spec;"
        "print(load_spec(Path(sys.argv[1])).diagnostics)"
    )
    said = {
        subprocess.run(
            [sys.executable, "-c", code, str(GOLDEN / "merged_and_shared.yaml")],
            capture_output=True,
            check=True,
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
        ).stdout
        for seed in range(4)
    }
    assert len(said) == 1


def test_text_that_looks_like_a_number_stays_text() -> None:
    content = (GOLDEN / "ok_minimal.yaml").read_text() + (
        'labels: {a: "1e3", b: "0o17", c: "on", d: "12:30", e: "null", f: "1.0", g: ""}\n'
    )
    loaded = load_spec(content)
    assert loaded.spec is not None
    again = load_spec(loaded.resolved_yaml()).spec
    assert again is not None
    assert again.labels == loaded.spec.labels


# What takes long to import is imported where it is needed, and not before.


ROOT = Path(__file__).parents[3]
ROS = ("rclpy", "cv2", "numpy")
LIBRARIES = (*ROS, "scipy", "rosbags", "rich", "psutil", "r2bspec.nodes")
EXPLAINERS = ("r2bspec.language.explain_violations", "networkx")
STAGES = ("r2bspec.language", "r2bspec.check", "r2bspec.plan", "r2bspec.diagnostics")
REPORTS = ("jinja2", "scipy", "mcap", "junitparser", "rich")
LOAD = "from pathlib import Path; from r2bspec.language.load_spec import load_spec; load_spec(Path"
MAIN = "from r2bspec.cli.main import main; main"


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
        ("import r2bspec.doctor.checks", ROS),
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
