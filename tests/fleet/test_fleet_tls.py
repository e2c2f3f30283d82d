"""A fleet with certificates, and what it refuses."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("distributed")
pytest.importorskip("cryptography")

from fleet_hosts import HANG_S, fleet, wait_until
from r2bspec.fleet.security import make_certificates
from ros_runs import Bench, relay_spec

pytestmark = pytest.mark.timeout(HANG_S)


def test_a_fleet_with_certificates_runs_and_refuses_those_without(tmp_path: Path) -> None:
    made = tmp_path / "certificates"
    make_certificates(made)
    scheduler = ["--protocol", "tls", "--tls-ca-file", str(made / "ca.pem")]
    scheduler += ["--tls-cert", str(made / "scheduler.pem")]
    scheduler += ["--tls-key", str(made / "scheduler-key.pem")]
    with fleet(tmp_path / "fleet", scheme="tls", scheduler_options=scheduler) as hosts:
        part = ["--ca", str(made / "ca.pem"), "--certificate", str(made / "worker.pem")]
        hosts.start_worker("a", *part, "--key", str(made / "worker-key.pem"))
        cluster = tmp_path / "cluster.yaml"
        cluster.write_text(
            f"scheduler: {hosts.address}\nca: {made}/ca.pem\n"
            f"certificate: {made}/client.pem\nkey: {made}/client-key.pem\n"
        )
        words = [sys.executable, "-m", "r2bspec", "fleet", "status", str(cluster)]
        shown = subprocess.run([*words, "--format", "json"], capture_output=True, check=True)
        assert [each["state"] for each in json.loads(shown.stdout)["hosts"]] == ["idle"]
        words[4] = "hosts"
        table = subprocess.run(words, capture_output=True, check=True, text=True)
        assert " a " in f" {table.stdout.splitlines()[-1]} "
        spec = Bench(tmp_path / "bench").write(relay_spec(), "relay")
        words = ["--ca", str(made / "ca.pem"), "--certificate", str(made / "client.pem")]
        words += ["--key", str(made / "client-key.pem"), "--smoke"]
        done = hosts.run(spec, *words, output=tmp_path / "out")
        assert list(done.kept()) == ["a/relay"], done.stderr
        strangers = tmp_path / "strangers"
        make_certificates(strangers)
        words = [word.replace(str(made), str(strangers)) for word in words]
        refused = hosts.run(spec, *words, output=tmp_path / "out2")
        assert refused.status == 2
        assert "do not trust each other" in refused.stderr
        stranger = [sys.executable, "-m", "r2bspec", "fleet", "worker", hosts.address]
        stranger += ["--no-doctor", "--folder", str(tmp_path / "stranger"), *words[:-1]]
        log = tmp_path / "stranger.log"
        with log.open("wb") as output:
            worker = subprocess.Popen(stranger, stdout=output, stderr=output)
        try:
            wait_until(lambda: "not in the fleet" in log.read_text(), "what keeps it out")
        finally:
            worker.terminate()
            assert worker.wait(60) == 0
        assert "do not trust each other" in log.read_text()
        assert "certificates of one authority" in log.read_text()
        (made / "client-key.pem").chmod(0o644)
        refused = hosts.run(spec, "--smoke", output=tmp_path / "out3", at=str(cluster))
        assert refused.status == 2
        assert "chmod 600" in refused.stderr
        hosts.scheme = "tcp"
        plain = hosts.run(spec, output=tmp_path / "out4")
        assert plain.status == 2
        assert "speaks TLS, and this end does not" in plain.stderr
        for done in (refused, plain):
            assert "R2B687" in done.stderr
            assert "Traceback" not in done.stderr
