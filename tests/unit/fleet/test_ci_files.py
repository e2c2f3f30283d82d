"""The files that people copy for a fleet are what their systems read."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from click.testing import CliRunner

from r2bspec.cli.fleet import command as fleet_verb
from r2bspec.cli.run import command as run_verb

CI = Path(__file__).parents[3] / "ci"
FILES = (
    "github/fleet-nightly.yml",
    "gitlab/fleet-nightly.gitlab-ci.yml",
    "kubernetes/fleet.yaml",
    "slurm/fleet.sbatch",
)


@pytest.mark.parametrize("name", FILES)
def test_every_option_that_a_file_uses_exists(name: str) -> None:
    words = re.findall(r"(?<![\w-])--[a-z][a-z-]+", (CI / name).read_text())
    helps = [CliRunner().invoke(run_verb, ["--help"]).output]
    helps += [
        CliRunner().invoke(command, ["--help"]).output for command in fleet_verb.commands.values()
    ]
    ours = set(re.findall(r"--[a-z][a-z-]+", "".join(helps)))
    others = {"--protocol", "--port", "--no-dashboard", "--tls-ca-file", "--tls-cert", "--tls-key"}
    others |= {"--dashboard-address"}
    others |= {"--job-name", "--nodes", "--ntasks-per-node", "--exclusive", "--time", "--signal"}
    assert set(words) <= ours | others


@pytest.mark.parametrize("name", FILES)
def test_every_file_says_what_was_not_tried(name: str) -> None:
    head = "\n".join((CI / name).read_text().splitlines()[:4])
    assert re.search(r"Not (tried|applied|submitted)", head)


def test_kubernetes_selects_the_pods_that_it_makes() -> None:
    documents: list[Any] = list(yaml.safe_load_all((CI / "kubernetes/fleet.yaml").read_text()))
    assert [each["kind"] for each in documents] == ["Deployment", "Service", "DaemonSet"]
    for document in documents:
        assert {"apiVersion", "kind", "metadata", "spec"} <= set(document)
        if document["kind"] == "Service":
            continue
        pod = document["spec"]["template"]
        assert document["spec"]["selector"]["matchLabels"] == pod["metadata"]["labels"]
        volumes = {volume["name"] for volume in pod["spec"]["volumes"]}
        for container in pod["spec"]["containers"]:
            assert {mount["name"] for mount in container["volumeMounts"]} == volumes
    service, scheduler = documents[1], documents[0]
    assert service["spec"]["selector"] == scheduler["spec"]["selector"]["matchLabels"]


def test_kubernetes_reads_every_field_by_its_published_schemas() -> None:
    kubernetes = pytest.importorskip("kubernetes_validate", reason="needs kubernetes-validate")
    newest = kubernetes.latest_version()
    for each in yaml.safe_load_all((CI / "kubernetes/fleet.yaml").read_text()):
        kubernetes.validate(each, newest, strict=True)
        each["spec"]["no_such_field"] = 1
        with pytest.raises(kubernetes.ValidationError, match="no_such_field"):
            kubernetes.validate(each, newest, strict=True)


@pytest.mark.parametrize(
    ("schema", "name"),
    [("vendor.github-workflows", FILES[0]), ("vendor.gitlab-ci", FILES[1])],
)
def test_a_pipeline_follows_the_published_schema_of_its_system(
    schema: str, name: str, tmp_path: Path
) -> None:
    words = [sys.executable, "-m", "check_jsonschema", "--builtin-schema", schema]
    done = subprocess.run([*words, str(CI / name)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    broken = tmp_path / Path(name).name
    text, count = re.subn(
        r"^( +)(runs-on|tags): .*$", r"\1\2: 7", (CI / name).read_text(), flags=re.MULTILINE
    )
    assert count == 1
    broken.write_text(text)
    done = subprocess.run([*words, str(broken)], capture_output=True, text=True)
    assert done.returncode == 1, done.stdout + done.stderr


def test_the_job_of_slurm_is_a_script() -> None:
    subprocess.run(["bash", "-n", str(CI / "slurm/fleet.sbatch")], check=True)  # noqa: S607
