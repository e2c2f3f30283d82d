"""Everything that launch files say of what they start is in the spec, or named with its line.

The spec of each file is stored beside it. With ``R2BSPEC_REWRITE=1`` in the environment it is
written instead of compared.
"""

from __future__ import annotations

import pytest

from golden import compare
from launch_specs import FOLDER, made, stored


@pytest.mark.parametrize("name", ["conditions.launch.py", "contents.launch.py"])
def test_the_spec_of_a_launch_file(name: str) -> None:
    _, text = made(name, stored(name))
    compare(text, FOLDER / f"{name}.r2b.yaml")
