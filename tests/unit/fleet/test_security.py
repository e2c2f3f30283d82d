"""Connections without TLS stay on this machine; journals survive what they must."""

from __future__ import annotations

import contextlib
import dataclasses
import datetime
import ipaddress
import os
import shutil
import socket
import ssl
import stat
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from r2bspec.cli.main import main
from r2bspec.errors import ExitStatus, UsageError
from r2bspec.fleet import security
from r2bspec.fleet.errors import FleetError, InsecureFleetError
from r2bspec.fleet.journal import JOURNAL_FILE, Journal, read_journal
from r2bspec.fleet.security import FleetAddress, fleet_address, listen_address

WILDCARDS = ("0.0.0.0", "::", "[::]", "0")  # noqa: S104 - which are refused


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
    assert found.value.hint


def test_insecure_goes_without() -> None:
    assert fleet_address("tcp://10.0.0.5:8786", insecure=True).ca is None


@pytest.mark.parametrize("listen", ["", "127.0.0.1", "127.9.9.9", "localhost", "::1", "[::1]"])
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
    assert refused.value.hint


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
    made = security.make_certificates(tmp_path / "certificates", ("10.0.0.5", "desk"))
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
        security.make_certificates(tmp_path / "certificates")


@pytest.mark.parametrize("name", ["", "büro", "a b", "x" * 64, "\x1b]0;x", "-.-..", "*"])
def test_a_certificate_is_for_names_of_hosts(name: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="neither the name of a host nor an address") as refused:
        security.make_certificates(tmp_path / "certificates", (name,))
    assert refused.value.hint
    assert not (tmp_path / "certificates").exists()


def test_certificates_are_not_written_where_no_folder_can_be(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    (tmp_path / "file").touch()
    for folder in (tmp_path / "file", tmp_path / "file" / "below", Path("/proc/x")):
        with pytest.raises(UsageError, match="cannot have certificates") as refused:
            security.make_certificates(folder)
        assert refused.value.hint


@pytest.fixture
def certificates(tmp_path: Path) -> Path:
    pytest.importorskip("cryptography")
    pytest.importorskip("distributed")
    security.make_certificates(tmp_path / "certificates")
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


@contextlib.contextmanager
def long_ago() -> Iterator[None]:
    """Certificates that are made now were valid until over a year ago."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(security, "_DAY", datetime.timedelta(days=1000))
        patch.setattr(security, "_YEARS", -0.001)
        yield


def expired(folder: Path) -> Path:
    with long_ago():
        security.make_certificates(folder)
    return folder


def test_an_expired_certificate_is_refused_at_once(certificates: Path, tmp_path: Path) -> None:
    with pytest.raises(InsecureFleetError, match="certificate has expired") as refused:
        client_address(expired(tmp_path / "expired")).security()
    assert "'r2bspec fleet certificates' makes new ones" in refused.value.hint


def test_a_certificate_of_another_authority_is_refused_at_once(
    certificates: Path, tmp_path: Path
) -> None:
    foreign = tmp_path / "foreign"
    security.make_certificates(foreign)
    shutil.copy(foreign / "ca.pem", certificates / "ca.pem")
    with pytest.raises(InsecureFleetError, match="signature failure|local issuer") as refused:
        client_address(certificates).security()
    assert str(certificates / "client.pem") in refused.value.hint


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o644, 0o620, 0o602, 0o666])
def test_a_key_that_others_can_read_is_refused(certificates: Path, mode: int) -> None:
    key = certificates / "client-key.pem"
    key.chmod(mode)
    os.chown(key, 1234, 1234) if os.getuid() == 0 else None
    with pytest.raises(InsecureFleetError, match=f"'chmod 600 {key}' keeps it private"):
        client_address(certificates).security()


@contextlib.contextmanager
def serving(folder: Path | None) -> Iterator[int]:
    """A server that greets as Dask does, with TLS if it has certificates; yields its port."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    if folder is not None:
        context.load_verify_locations(folder / "ca.pem")
        context.load_cert_chain(folder / "scheduler.pem", folder / "scheduler-key.pem")
        context.verify_mode = ssl.CERT_REQUIRED
    with contextlib.ExitStack() as stack:
        server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))

        def serve() -> None:
            while True:
                try:
                    connection = stack.enter_context(server.accept()[0])
                except OSError:
                    return
                with contextlib.suppress(OSError):
                    if folder is not None:
                        connection = context.wrap_socket(connection, server_side=True)
                    connection.sendall(b"\x01" + bytes(7))
                    connection.recv(100)
                connection.close()

        thread = threading.Thread(target=serve)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
        thread.join()


@pytest.mark.parametrize(
    ("there", "here", "message"),
    [
        ("good", "good", ""),
        ("", "", ""),
        ("expired", "good", "do not trust each other: certificate signature failure"),
        ("aged", "good", "do not trust each other: certificate has expired"),
        ("good", "foreign", "do not trust each other: certificate signature failure"),
        ("good", "", "speaks TLS, and this end does not"),
        ("", "good", "does not speak TLS"),
    ],
)
def test_why_two_ends_have_no_connection_is_said_at_once(
    there: str, here: str, message: str, certificates: Path, tmp_path: Path
) -> None:
    foreign, aged = tmp_path / "foreign", tmp_path / "aged"
    security.make_certificates(foreign)
    with long_ago():
        from cryptography.hazmat.primitives import serialization
        from cryptography.hazmat.primitives.asymmetric import ec

        # One certificate of the good authority whose time is over.
        key = serialization.load_pem_private_key((certificates / "ca-key.pem").read_bytes(), None)
        shutil.copytree(certificates, aged)
        for part in ("scheduler.pem", "scheduler-key.pem"):
            (aged / part).unlink()
        own = ec.generate_private_key(ec.SECP256R1())
        made = security._certificate("scheduler", own, key, ("localhost",))
        security._write(aged, "scheduler", made, own)
    folders = {"good": certificates, "foreign": foreign, "aged": aged}
    folders["expired"] = expired(tmp_path / "expired")
    with serving(folders.get(there)) as port:
        place = f"127.0.0.1:{port}"
        address = FleetAddress(scheduler=f"tcp://{place}")
        if here:
            address = dataclasses.replace(client_address(folders[here]), scheduler=f"tls://{place}")
        refusal = address.refusal()
    if not message:
        assert refusal is None
        return
    assert refusal is not None
    assert (refusal.code, str(refusal).startswith(address.scheduler)) == ("R2B687", True)
    assert message in str(refusal)
    assert refusal.hint


def test_a_server_that_is_not_there_is_no_matter_of_tls(certificates: Path) -> None:
    address = dataclasses.replace(client_address(certificates), scheduler="tls://127.0.0.1:9")
    assert address.refusal() is None


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
        file.write(b'{"at":"2026","run":"a/re')
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


def test_a_worker_uses_no_folder_that_others_can_fill(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What lies there is played, and what is sent is written there."""
    (tmp_path / "open").mkdir()
    (tmp_path / "open").chmod(0o777)
    (tmp_path / "clone/.git").mkdir(parents=True)
    for folder, reason in {
        "open": "other users can write",
        "clone/x": "a work tree of git",
    }.items():
        words = ["--folder", str(tmp_path / folder), "--no-doctor"]
        assert main(["fleet", "worker", "tcp://127.0.0.1:9", *words]) == ExitStatus.USAGE
        assert reason in capsys.readouterr().err
