"""Promise: `interfaces` and the functions of `api` read no more of a stranger than the verbs."""

from __future__ import annotations

from pathlib import Path

import pytest

from command_line import Call
from example_spec import example
from r2bspec import api
from r2bspec.language.environment_access import UntrustedSpecs


@pytest.fixture
def listed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A spec that lists a variable."""
    monkeypatch.setenv("NAME_OF_IT", "relay")
    spec = tmp_path / "listed.r2b.yaml"
    spec.write_text(example(environment="[NAME_OF_IT]"), encoding="utf-8")
    return spec


def test_interfaces_refuses_a_variable_before_a_node_starts(listed: Path, call: Call) -> None:
    shown = call("interfaces", "--untrusted", listed, status=2).err
    assert "R2B143" in shown
    assert "starting" not in shown
    assert not (listed.parent / "interfaces").exists()


def test_interfaces_refuses_a_link_out_of_the_folder(
    listed: Path, tmp_path: Path, call: Call
) -> None:
    folder = tmp_path / "other"
    folder.mkdir()
    (folder / "linked.r2b.yaml").symlink_to(listed)
    assert "R2B001" in call("interfaces", folder / "linked.r2b.yaml", status=2).err


def test_the_functions_take_what_the_verbs_take(listed: Path, tmp_path: Path) -> None:
    untrusted = UntrustedSpecs()
    assert "R2B143" in {one.code for one in api.validate(listed, untrusted=untrusted)}
    assert "R2B143" not in {one.code for one in api.validate(listed)}
    for function in (api.load, api.compile_plan):
        with pytest.raises(api.InvalidSpecError) as caught:
            function(listed, untrusted=untrusted)
        assert "R2B143" in {diagnostic.code for diagnostic in caught.value.diagnostics}
    folder = tmp_path / "other"
    folder.mkdir()
    linked = folder / "linked.r2b.yaml"
    linked.symlink_to(listed)
    assert "R2B001" in {one.code for one in api.validate(linked)}
    assert "R2B001" not in {one.code for one in api.validate(linked, allow_paths=[tmp_path])}
    with pytest.raises(api.InvalidSpecError):
        api.load(linked)
    assert api.load(linked, allow_paths=[tmp_path]).name == "example"
