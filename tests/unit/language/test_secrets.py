"""Promise: no verb prints the value of a secret, or a part of it, wherever a spec refers to it.

It is checked by comparison: what a verb prints does not change with the value. So it cannot show
the value, a part of it, its length, or what it resembles.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from nightly import sampled
from r2bspec.cli.main import main
from r2bspec.language.load_spec import load_spec
from r2bspec.language.located_tree import to_plain
from r2bspec.language.secrets import is_secret_key, is_secret_variable, shown_value

SPEC = Path(__file__).with_name("secrets.r2b.yaml").read_text(encoding="utf-8")

VALUES = (
    "ghp_0123456789abcdefghij",
    "-----BEGIN RSA PRIVATE KEY-----\nMIIE" + "x" * 200,
    "10 Hz",  # right where a rate is wanted
    "r2b_storage",  # the name of a dataset
    "r2b_storag",  # that a suggestion would be made for
    "r2bspec.nodes.RelayNode",
    "2",
    "",
    "a" * 59 + "bcdefg",  # that would be clipped
    "$(env DEPLOY_TOKEN)",
    "\x1b[31m::error::x",
)

PLACES = yaml.safe_load(Path(__file__).with_name("secret_places.yaml").read_text(encoding="utf-8"))
REFUSED, ALLOWED = PLACES["refused"], PLACES["allowed"]

VERBS = (
    ["validate"],
    *(["validate", f"--format={each}"] for each in ("github", "sarif", "json", "junit")),
    ["validate", "--resolved"],
    ["validate", "--diff"],
    ["plan"],
    ["plan", "--graph=mermaid"],
    ["plan", "--graph=html"],
    *(
        ["plan", f"--explain={path}"]
        for path in ("variables.words", "labels.x", "benchmark.duration", "data_loader.bag")
    ),
)


@pytest.fixture(autouse=True)
def without_other_secrets(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("R2B_DATASETS", raising=False)


def printed(
    file: Path, capsys: pytest.CaptureFixture[str], *, verbs: tuple[list[str], ...] = VERBS
) -> Iterator[str]:
    """All that the verbs print about a spec, with their exit statuses."""
    for verb in verbs:
        status = main([*verb, str(file)])
        said = capsys.readouterr()
        yield f"{verb}: {status}\n{said.out}{said.err}"


@pytest.mark.parametrize("place", [*REFUSED, *ALLOWED])
@pytest.mark.parametrize("reference", ["$(env DEPLOY_TOKEN)", "$(var words)"])
def test_what_is_printed_does_not_depend_on_the_value(
    place: str,
    reference: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    old, new = (REFUSED | ALLOWED)[place]
    assert SPEC.count(old) == 1
    file = tmp_path / "a.r2b.yaml"
    file.write_text(SPEC.replace(old, new.replace("REF", reference)))
    said = set()
    # In a sample each place has other values.
    first = [*REFUSED, *ALLOWED].index(place) % 3
    for value in sampled(VALUES[first:] + VALUES[:first], 3):
        monkeypatch.setenv("DEPLOY_TOKEN", value)
        said.add("".join(printed(file, capsys, verbs=(["validate"], ["plan"]))))
    assert len(said) == 1, said


@pytest.mark.parametrize("place", REFUSED)
def test_every_format_of_findings_names_the_variable_only(
    place: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    value = "Zq7-Xv9+wK3-bT5" * 8
    monkeypatch.setenv("DEPLOY_TOKEN", value)
    old, new = REFUSED[place]
    file = tmp_path / "a.r2b.yaml"
    file.write_text(SPEC.replace(old, new.replace("REF", "$(env DEPLOY_TOKEN)")))
    for said in printed(file, capsys):
        assert not [at for at in range(len(value) - 4) if value[at : at + 5] in said]
    assert main(["validate", str(file)]) == 1
    assert "R2B142" in capsys.readouterr().out


@pytest.mark.parametrize("place", ALLOWED)
def test_elsewhere_the_document_keeps_the_reference(place: str) -> None:
    old, new = ALLOWED[place]
    text = SPEC.replace(old, new.replace("REF", "$( env  DEPLOY_TOKEN )"))
    loaded = load_spec(text, environ={"DEPLOY_TOKEN": "very-secret"})
    assert loaded.spec is not None, loaded.diagnostics
    resolved = loaded.resolved_yaml()
    assert "very-secret" not in resolved
    assert resolved.count("$(env DEPLOY_TOKEN)") >= 2
    assert loaded.tree is not None
    assert "very-secret" not in json.dumps(to_plain(loaded.tree))


@pytest.mark.parametrize(
    ("value", "label"), [("/data", "/data"), ("$(env DEPLOY_TOKEN)", "$(env DATA)")]
)
def test_another_variable_is_replaced_unless_its_value_holds_a_reference(
    value: str, label: str
) -> None:
    text = SPEC.replace("[DEPLOY_TOKEN]", "[DEPLOY_TOKEN, DATA]")
    text = text.replace("{x: 1}", "{x: $(env DATA)}")
    loaded = load_spec(text, environ={"DEPLOY_TOKEN": "s", "DATA": value})
    assert loaded.spec is not None
    assert loaded.spec.labels["x"] == label


@pytest.mark.parametrize(
    "name",
    [
        *("API_TOKEN", "aws_secret_access_key", "DBPASSWORD", "SSH_PRIVATE", "SESSION_COOKIE"),
        *("GH_PAT", "MYSQL_PWD", "SENTRY_DSN", "CI_JOB_JWT", "SLACK_WEBHOOK_URL", "Basic_Auth"),
        *("GOOGLE_APPLICATION_CREDENTIALS", "APIKEY"),
    ],
)
def test_names_of_secrets(name: str) -> None:
    assert is_secret_variable(name)
    assert shown_value(name, "abc") == "***"
    assert shown_value(name, "") == ""


@pytest.mark.parametrize(
    "value",
    [
        "https://gitlab-ci-token:0123456789@gitlab.example.org/a/b.git",
        "postgresql://user:pw@db:5432/x",
        "-----BEGIN OPENSSH PRIVATE KEY-----\nabc",
        "ghp_0123456789abcdefghijABCDEFGHIJ",
        "github_pat_0123456789abcdef",
        "glpat-0123456789abcdefghij",
        "token AKIAIOSFODNN7EXAMPLE",
        "eyJhbGciOiJIUzI1NiJ9.eyJzdWIiOiIxIn0.abc",
    ],
)
def test_values_of_secrets_under_any_name(value: str) -> None:
    assert is_secret_variable("CI_REPOSITORY", value)
    assert shown_value("CI_REPOSITORY", value) == "***"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("HOME", "/home/someone"),
        ("PWD", "/work"),
        ("OLDPWD", "/work"),
        ("PATH", "/usr/bin:/bin"),
        ("DATA_DIR", "https://example.org/data@1:2"),
        ("PATTERN", "glass-panel-0123456789"),
        ("ROS_DISTRO", "jazzy"),
    ],
)
def test_what_is_no_secret(name: str, value: str) -> None:
    assert not is_secret_variable(name, value)
    assert shown_value(name, value) == value


def test_fewer_keys_than_variables_name_secrets() -> None:
    assert is_secret_key("camera.password")
    assert not is_secret_key("key")
    assert not is_secret_key("passthrough")
