"""Connections without TLS stay on this machine; journals survive what they must."""

from __future__ import annotations

import contextlib
import ipaddress
import socket
import ssl
import stat
import threading
from pathlib import Path

import pytest

from r2bspec.errors import UsageError
from r2bspec.fleet.errors import FleetError, InsecureFleetError
from r2bspec.fleet.journal import JOURNAL_FILE, Journal, read_journal
from r2bspec.fleet.security import FleetAddress, fleet_address, listen_address

WILDCARDS = ("0.0.0.0", "::", "0")  # noqa: S104 - which are refused


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:8786", "tcp://localhost", "tcp://[::1]:9"])
def test_this_machine_needs_no_tls(address: str) -> None:
    found = fleet_address(address)
    assert found.scheduler == (address if address != "tcp://localhost" else f"{address}:8786")
    assert found.ca is None


@pytest.mark.parametrize(
    ("address", "message"),
    [
        ("tcp://10.0.0.5:8786", "would not be encrypted"),
        ("tcp://localhost.example.com", "would not be encrypted"),
        ("tls://10.0.0.5:8786", "needs a certificate"),
        ("http://10.0.0.5", "no address of a scheduler"),
        ("tcp://", "no address of a scheduler"),
        ("nowhere.yaml", "neither an address nor a cluster file"),
    ],
)
def test_what_is_not_secure_is_refused(address: str, message: str) -> None:
    with pytest.raises(InsecureFleetError, match=message) as found:
        fleet_address(address)
    assert found.value.code == "R2B687"


def test_insecure_goes_without() -> None:
    assert fleet_address("tcp://10.0.0.5:8786", insecure=True).ca is None


@pytest.mark.parametrize("listen", ["", "127.0.0.1", "127.9.9.9", "localhost", "::1"])
def test_a_worker_without_tls_listens_on_this_machine_only(listen: str) -> None:
    place = listen_address(fleet_address("tcp://localhost:8786"), listen)
    assert ipaddress.ip_address(place).is_loopback


@pytest.mark.parametrize("insecure", [False, True])
@pytest.mark.parametrize("listen", [*WILDCARDS, "10.0.0.5", "tcp://0.0.0.0:0", "no.where."])
def test_a_worker_without_tls_refuses_any_other_place(listen: str, insecure: bool) -> None:
    address = fleet_address("tcp://127.0.0.1:8786", insecure=insecure)
    with pytest.raises(InsecureFleetError) as refused:
        listen_address(address, listen)
    assert refused.value.code == "R2B687"


@pytest.mark.parametrize("listen", WILDCARDS)
def test_no_wildcard_is_listened_on_without_tls_even_in_a_trusted_network(listen: str) -> None:
    address = fleet_address("tcp://10.0.0.5:8786", insecure=True)
    with pytest.raises(InsecureFleetError, match="every machine that reaches this one"):
        listen_address(address, listen)
    assert listen_address(address, "10.0.0.7") == "10.0.0.7"


def test_a_worker_with_tls_may_listen_anywhere(tmp_path: Path) -> None:
    address = FleetAddress(scheduler="tls://10.0.0.5:8786", ca=tmp_path / "ca.pem")
    assert listen_address(address, "") == ""
    assert listen_address(address, "0.0.0.0") == "0.0.0.0"  # noqa: S104


def test_a_cluster_file_names_scheduler_and_certificates(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    from r2bspec.fleet.security import make_certificates

    made = make_certificates(tmp_path / "certificates", ("10.0.0.5", "desk"))
    assert {stat.S_IMODE(each.stat().st_mode) for each in made} == {0o600}
    file = tmp_path / "cluster.yaml"
    file.write_text(
        "scheduler: tls://10.0.0.5:8786\nca: certificates/ca.pem\n"
        "certificate: certificates/client.pem\nkey: certificates/client-key.pem\n"
    )
    found = fleet_address(str(file))
    assert found.certificate == tmp_path / "certificates" / "client.pem"
    context = ssl.create_default_context(ssl.Purpose.SERVER_AUTH, cafile=str(found.ca))
    context.load_cert_chain(str(found.certificate), str(found.key))
    file.write_text("scheduler: tls://10.0.0.5\nauthority: x\n")
    with pytest.raises(InsecureFleetError, match="unknown key 'authority'"):
        fleet_address(str(file))
    with pytest.raises(InsecureFleetError, match="not empty"):
        make_certificates(tmp_path / "certificates")


@pytest.fixture
def certificates(tmp_path: Path) -> Path:
    pytest.importorskip("cryptography")
    pytest.importorskip("distributed")
    from r2bspec.fleet.security import make_certificates

    make_certificates(tmp_path / "certificates")
    return tmp_path / "certificates"


def client_address(certificates: Path, key: str = "client-key.pem") -> FleetAddress:
    return fleet_address(
        "tls://10.0.0.5",
        ca=certificates / "ca.pem",
        certificate=certificates / "client.pem",
        key=certificates / key,
    )


@pytest.mark.parametrize("broken", ["ca.pem", "client.pem", "client-key.pem"])
def test_files_that_are_no_certificates_are_said_to_be_none(
    certificates: Path, broken: str
) -> None:
    address = client_address(certificates)
    assert address.security() is not None
    (certificates / broken).write_text("garbage")
    with pytest.raises(InsecureFleetError, match="certificates cannot be used") as found:
        address.security()
    assert str(certificates / broken) in found.value.hint


def test_a_key_of_another_certificate_is_refused(certificates: Path) -> None:
    with pytest.raises(InsecureFleetError, match="mismatch"):
        client_address(certificates, "worker-key.pem").security()


@pytest.mark.parametrize("says", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n"])
def test_a_server_that_is_no_scheduler_is_not_waited_for(
    monkeypatch: pytest.MonkeyPatch, says: bytes
) -> None:
    pytest.importorskip("distributed")
    from r2bspec.fleet import client

    monkeypatch.setattr(client, "_CONNECT_S", 0.5)
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    stack.enter_context(server.accept()[0]).sendall(says)

        thread = threading.Thread(target=serve)
        thread.start()
        address = fleet_address(f"tcp://127.0.0.1:{server.getsockname()[1]}")
        with pytest.raises(FleetError, match="does not answer") as found:
            client.FleetClient(address)
        server.shutdown(socket.SHUT_RDWR)
        thread.join()
    assert found.value.code == "R2B682"


def test_a_journal_is_continued_after_a_line_that_was_cut_off(tmp_path: Path) -> None:
    first = Journal(tmp_path)
    first.write(run="a/relay", host="a", identity="1", attempt=1, state="sent")
    with pytest.raises(UsageError, match="another client"):
        Journal(tmp_path)
    first.close()
    with (tmp_path / JOURNAL_FILE).open("ab") as file:
        file.write(b'{"at":"2026","run":"a/re\n')
    again = Journal(tmp_path)
    again.write(run="a/relay", host="a", identity="1", attempt=1, state="done")
    again.close()
    assert again.suite == first.suite
    assert again.hosts == {"a"}
    assert [each.state for each in read_journal(tmp_path)] == ["", "sent", "done"]


def test_a_file_that_is_no_journal_is_refused(tmp_path: Path) -> None:
    (tmp_path / JOURNAL_FILE).write_text("hello\n")
    with pytest.raises(UsageError, match="no journal"):
        Journal(tmp_path)
