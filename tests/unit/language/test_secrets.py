"""Values of secrets are in no plan and no record: nothing can refer to them."""

from __future__ import annotations

import pytest

from example_spec import example
from r2bspec.language.load_spec import load_spec
from r2bspec.language.secrets import is_secret_variable, shown_value


@pytest.mark.parametrize(
    ("name", "secret"),
    [
        ("API_KEY", True),
        ("password", True),
        ("GITHUB_PAT", True),
        ("PWD", False),
        ("PATH", False),
        ("DATA_DIR", False),
    ],
)
def test_a_secret_is_known_by_its_name(name: str, secret: bool) -> None:
    assert is_secret_variable(name) is secret
    assert shown_value(name, "value") == ("***" if secret else "value")


def test_a_reference_to_a_secret_is_refused_and_its_value_not_shown() -> None:
    text = example(environment="[API_TOKEN]", title="$(env API_TOKEN)")
    (found,) = load_spec(text, environ={"API_TOKEN": "s3cret"}).diagnostics
    assert found.code == "R2B142"
    assert "s3cret" not in f"{found}"
