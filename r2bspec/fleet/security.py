"""Connections of a fleet: where they may go, and where a worker listens; TLS beyond this machine.

Dask runs what anybody sends who can connect. So nothing leaves this machine without TLS, and
nothing listens beyond it, unless `--insecure` says that every machine of the network is trusted.

The certificates of a fleet are those of one authority, with one for each part. Dask checks that
both ends have a certificate of the authority, and nothing else: not names, and not roles. So every
holder of a certificate is trusted as much as any other.

What r2bspec sends are bytes of MessagePack (`r2bspec.fleet.messages`). Dask 2026.8 unpickles
besides, whatever its options say: every value that a message marks so (``__Pickled__``), in
scheduler, workers and clients; the graph of a task, in the scheduler and the worker; the function
and the type of its result; exceptions; and what ``run`` and plugins bring along, which cannot be
turned off. A value that a client gathers is the one thing that it can insist on as MessagePack.
"""

from __future__ import annotations

import contextlib
import datetime
import ipaddress
import os
import re
import socket
import ssl
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

import msgspec

from r2bspec.diagnostics.quote import quote
from r2bspec.errors import UsageError
from r2bspec.fleet.errors import FleetNotInstalledError, InsecureFleetError
from r2bspec.safe_io.limits import MAX_FLEET_FILE_BYTES
from r2bspec.safe_io.safe_file import is_there, read_text
from r2bspec.safe_io.safe_yaml import load_values

if TYPE_CHECKING:
    from distributed.security import Security

_KEYS: Final = frozenset({"scheduler", "ca", "certificate", "key"})
_SCHEMES: Final = ("tcp", "tls")
_DEFAULT_PORT: Final = 8786

PARTS: Final = ("scheduler", "worker", "client")
_USES: Final = (
    *("digital_signature", "content_commitment", "key_encipherment", "data_encipherment"),
    *("key_agreement", "key_cert_sign", "crl_sign", "encipher_only", "decipher_only"),
)
_YEARS: Final = 2
_REFUSAL_S: Final = 2.0
_HOST_NAME: Final = re.compile(r"(\*\.)?[A-Za-z0-9_-]{1,63}(\.[A-Za-z0-9_-]{1,63}){0,10}\.?")
_DAY: Final = datetime.timedelta(days=1)


@dataclass(frozen=True, kw_only=True)
class FleetAddress:
    """Where the scheduler of a fleet is, and how it is trusted.

    Attributes:
        scheduler: such as ``tls://10.0.0.5:8786``.
        ca: the certificate that signs those of the fleet; None without TLS.
        certificate: of this program.
        key: of the certificate.
    """

    scheduler: str
    ca: Path | None = None
    certificate: Path | None = None
    key: Path | None = None

    def security(self) -> Security | None:
        """The TLS settings for Dask; None without TLS.

        Raises:
            FleetNotInstalledError: Dask distributed is missing.
            InsecureFleetError: a file is no certificate, or not of its key.
        """
        require_distributed()
        from distributed.security import Security

        if self.ca is None:
            return None
        files = {"cert": str(self.certificate), "key": str(self.key)}
        roles = {
            f"tls_{role}_{kind}": path
            for role in ("client", "worker", "scheduler")
            for kind, path in files.items()
        }
        security = Security(  # type: ignore[no-untyped-call]
            tls_ca_file=str(self.ca), require_encryption=True, **roles
        )
        try:
            _require_private(self.key)
            _shake_hands(
                security.get_connection_args("client")["ssl_context"],  # type: ignore[no-untyped-call]
                security.get_listen_args("worker")["ssl_context"],  # type: ignore[no-untyped-call]
            )
        except (OSError, ValueError) as error:
            named = ", ".join(map(str, (self.ca, self.certificate, self.key)))
            raise InsecureFleetError(
                f"the certificates cannot be used: {_reason(error)}",
                hint=f"Their files are {named}; 'r2bspec fleet certificates' makes new ones.",
            ) from error
        return security

    def refusal(self) -> InsecureFleetError | None:
        """Why TLS keeps this end from the scheduler, after it could not connect; None if not."""
        place = urlsplit(self.scheduler)
        security = self.security()
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
        if security is not None:
            context = security.get_connection_args("client")["ssl_context"]  # type: ignore[no-untyped-call]
        reason = ""
        try:
            address = (place.hostname or "", place.port or _DEFAULT_PORT)
            with (
                socket.create_connection(address, _REFUSAL_S) as plain,
                context.wrap_socket(plain) as encrypted,
            ):
                encrypted.recv(1)  # a server says only now that it refuses the certificate
        except ssl.SSLError as error:
            reason = _reason(error)
        except OSError:
            return None
        has_tls = not reason or "alert" in reason or "certificate" in reason
        if security is None:
            text = f"{self.scheduler} speaks TLS, and this end does not"
            hint = "Use tls:// with the certificates of the fleet, or a cluster file."
            return InsecureFleetError(text, hint=hint) if has_tls else None
        text = f"{self.scheduler} and this end do not trust each other: {reason}"
        hint = (
            "Both ends need certificates of one authority that have not expired: 'r2bspec fleet "
            f"certificates' makes new ones for all parts. This end has {self.certificate}."
        )
        if not has_tls:
            text = f"{self.scheduler} does not speak TLS: {reason}"
            hint = "Start it with 'dask scheduler --protocol tls' and its certificates."
        return InsecureFleetError(text, hint=hint) if reason else None


def _reason(error: Exception) -> str:
    """The cause that OpenSSL gives, in its words: ``certificate has expired``."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return error.verify_message
    if isinstance(error, ssl.SSLError) and error.reason:
        return error.reason.lower().replace("_", " ")
    return str(error)


def _require_private(key: Path | None) -> None:
    """See that nobody else reads a key; a group may read one that belongs to root.

    Raises:
        OSError: it cannot be read.
        ValueError: somebody else can.
    """
    assert key is not None  # noqa: S101 - with TLS
    status = key.stat()
    if status.st_mode & (0o037 if status.st_uid == 0 else 0o077):
        raise ValueError(f"other users can read {key}; 'chmod 600 {key}' keeps it private")


def _shake_hands(client: ssl.SSLContext, server: ssl.SSLContext) -> None:
    """Let two ends with one certificate meet, without a network: each must trust the other.

    Raises:
        ssl.SSLError: they do not: it has expired, or is not of the authority.
    """
    to_client, to_server = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = (
        client.wrap_bio(to_client, to_server),
        server.wrap_bio(to_server, to_client, server_side=True),
    )
    for end in ends * 2:
        with contextlib.suppress(ssl.SSLWantReadError):
            end.do_handshake()


def fleet_address(
    on: str,
    *,
    ca: Path | None = None,
    certificate: Path | None = None,
    key: Path | None = None,
    insecure: bool = False,
) -> FleetAddress:
    """The address of a scheduler, or that of a cluster file.

    A cluster file is YAML with the keys ``scheduler``, ``ca``, ``certificate`` and ``key``; paths
    are relative to it.

    Args:
        on: ``tcp://HOST:PORT``, ``tls://HOST:PORT``, or the path of a cluster file.
        ca: replaces that of the file, as the next two do.
        certificate: of this program.
        key: of the certificate.
        insecure: whether a connection without TLS may leave this machine.

    Raises:
        InsecureFleetError: TLS is missing where it is needed, or has no certificates.
    """
    values: dict[str, str] = {"scheduler": on}
    folder = Path()
    if "://" not in on:
        values, folder = _read_cluster_file(Path(on)), Path(on).parent
    address = _with_port(values.get("scheduler", ""))
    paths = {
        name: given or (folder / values[name] if name in values else None)
        for name, given in (("ca", ca), ("certificate", certificate), ("key", key))
    }
    for name, path in paths.items():
        if path is not None and not is_there(path):
            raise InsecureFleetError(
                f"the file of {name}, {path}, does not exist",
                hint="'r2bspec fleet certificates FOLDER' makes all files of a fleet.",
            )
    scheme = urlsplit(address).scheme
    if scheme == "tls" and None in paths.values():
        raise InsecureFleetError(
            f"{address} needs a certificate",
            hint="Make certificates with 'r2bspec fleet certificates', and name them with --ca, "
            "--certificate and --key, or in a cluster file.",
        )
    if scheme == "tcp" and not insecure and not is_loopback(address):
        raise InsecureFleetError(
            f"{address} is not on this machine, and the connection would not be encrypted",
            hint="Use tls:// with certificates ('r2bspec fleet certificates'), or --insecure in a "
            "network where every machine is trusted: who reaches the scheduler runs programs on "
            "every host.",
        )
    return FleetAddress(scheduler=address, **(paths if scheme == "tls" else {}))


def listen_address(address: FleetAddress, listen: str) -> str:
    """Where a worker listens; empty for all interfaces, which only TLS may use.

    Without TLS it is the loopback interface, or, if the scheduler is on another machine of a
    trusted network (``--insecure``), one address: that which reaches the scheduler, or `listen`.

    Args:
        address: of the scheduler.
        listen: an address or name of this machine, as its owner wrote it; empty for the usual one.

    Raises:
        InsecureFleetError: anybody else could reach the worker without a certificate.
    """
    if address.ca is not None:
        return listen
    is_local = is_loopback(address.scheduler)
    if not listen:
        return "127.0.0.1" if is_local else _own_address(address.scheduler)
    place = _resolved(listen)
    if place.is_unspecified or (is_local and not place.is_loopback):
        raise InsecureFleetError(
            f"--listen {listen} without TLS would let every machine that reaches this one run "
            "programs here",
            hint="Leave --listen out, or use a tls:// scheduler with certificates "
            "('r2bspec fleet certificates').",
        )
    return str(place)


def _own_address(scheduler: str) -> str:
    """The address of this machine from which a scheduler is reached; nothing is sent."""
    from distributed.utils import get_ip, get_ipv6

    place = _resolved(urlsplit(scheduler).hostname or "")
    own = get_ipv6 if place.version == 6 else get_ip
    return str(own(str(place)))


def _resolved(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address:
    """What a name means now: it is this that is bound, so that it cannot mean another later."""
    try:
        host = name.removeprefix("[").removesuffix("]")
        address = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0]
        return ipaddress.ip_address(str(address).partition("%")[0])
    except (OSError, ValueError) as error:
        raise InsecureFleetError(
            f"{quote(name)} is no address: {error}",
            hint="Name an address or a host without its port, such as 127.0.0.1.",
        ) from error


def is_loopback(address: str) -> bool:
    """Whether an address is on this machine whatever its names mean."""
    host = urlsplit(address).hostname or ""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def require_distributed() -> None:
    """See that Dask distributed is installed.

    Raises:
        FleetNotInstalledError: it is not.
    """
    import importlib.util

    if importlib.util.find_spec("distributed") is None:
        raise FleetNotInstalledError(
            "a fleet needs Dask distributed, which is not installed",
            hint="pip install 'r2bspec[fleet]'",
        )


def quiet_logs() -> None:
    """Keep Dask's log off the terminal: what matters of it is an error of r2bspec."""
    import logging

    import distributed  # noqa: F401 - it sets the levels of its loggers when it is imported

    for name in logging.root.manager.loggerDict:
        if name.partition(".")[0] in ("distributed", "tornado", "bokeh"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    logging.getLogger("distributed").setLevel(logging.CRITICAL + 1)


def _with_port(address: str) -> str:
    try:
        parts = urlsplit(address)
        is_address = parts.scheme in _SCHEMES and bool(parts.hostname)
        port = parts.port
    except ValueError:
        is_address, port = False, None
    if "@" in address:
        raise InsecureFleetError(
            "an address of a scheduler has neither user nor password",
            hint="A scheduler knows its clients by their certificates: tls://HOST:PORT.",
        )
    if not is_address:
        raise InsecureFleetError(
            f"{address!r} is no address of a scheduler",
            hint="An address is tls://HOST:PORT or tcp://HOST:PORT.",
        )
    return address if port is not None else f"{address}:{_DEFAULT_PORT}"


def _read_cluster_file(path: Path) -> dict[str, str]:
    try:
        content = load_values(read_text(path, max_bytes=MAX_FLEET_FILE_BYTES))
        values = msgspec.convert(content, dict[str, str])
    except OSError as error:
        raise InsecureFleetError(
            f"{path} is neither an address nor a cluster file that can be read: "
            f"{error.strerror or error}",
            hint="An address is tls://HOST:PORT or tcp://HOST:PORT.",
        ) from error
    except Exception as error:
        raise InsecureFleetError(
            f"{path} is not a cluster file: {error}",
            hint=f"It is YAML, a text for each of the keys {', '.join(sorted(_KEYS))}.",
        ) from error
    if unknown := sorted(set(values) - _KEYS):
        raise InsecureFleetError(
            f"{path} has the unknown key {unknown[0]!r}",
            hint=f"Its keys are {', '.join(sorted(_KEYS))}.",
        )
    return values


def make_certificates(folder: Path, names: tuple[str, ...] = ()) -> list[Path]:
    """Make an authority, and certificates for scheduler, workers and clients; returns the files.

    Args:
        folder: for the files, new or empty. The key of the authority, ``ca-key.pem``, is only
            needed to make further certificates, and belongs off the network.
        names: host names and addresses for the certificates.

    Raises:
        FleetNotInstalledError: the package `cryptography` is missing.
        InsecureFleetError: the folder has files, whose keys may be in use.
        UsageError: the folder cannot be written, or a name is none.
    """
    for each in names:
        if not _is_address(each) and not _HOST_NAME.fullmatch(each):
            raise UsageError(
                f"--host {quote(each)} is neither the name of a host nor an address",
                hint="Give one such as robot.local, *.lab.example or 10.0.0.5.",
            )
    try:
        return _make_certificates(folder, names)
    except OSError as error:
        raise UsageError(
            f"{folder} cannot have certificates: {error.strerror}",
            hint="Name a new folder where you may write.",
        ) from error


def _make_certificates(folder: Path, names: tuple[str, ...]) -> list[Path]:
    try:
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError as error:
        raise FleetNotInstalledError(
            "certificates need the package cryptography, which is not installed",
            hint="pip install 'r2bspec[fleet]', or make them with another tool.",
        ) from error
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise InsecureFleetError(
            f"{folder} is not empty: its keys may be in use",
            hint="Name a new folder; to replace the keys of a fleet, remove this one first.",
        )
    keys = {part: ec.generate_private_key(ec.SECP256R1()) for part in ("ca", *PARTS)}
    files = []
    for part, key in keys.items():
        certificate = _certificate(part, key, keys["ca"], names or ("localhost", "127.0.0.1"))
        files += _write(folder, part, certificate, key)
    return files


def _is_address(text: str) -> bool:
    try:
        ipaddress.ip_address(text)
    except ValueError:
        return False
    return True


def _certificate(part: str, key: Any, authority_key: Any, names: tuple[str, ...]) -> Any:
    """The certificate of a part, or that of the authority, which is ``ca``."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

    def name(text: str) -> Any:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    def alternative(text: str) -> x509.GeneralName:
        is_address = _is_address(text)
        return x509.IPAddress(ipaddress.ip_address(text)) if is_address else x509.DNSName(text)

    is_authority = part == "ca"
    uses = dict.fromkeys(_USES, False)
    uses |= {"key_cert_sign": is_authority, "digital_signature": not is_authority}
    now = datetime.datetime.now(datetime.UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(name("r2bspec fleet" if is_authority else f"r2bspec {part}"))
        .issuer_name(name("r2bspec fleet"))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _DAY)  # clocks of robots differ
        .not_valid_after(now + _YEARS * 365 * _DAY)
        .add_extension(x509.BasicConstraints(is_authority, 0 if is_authority else None), True)
        .add_extension(x509.KeyUsage(**uses), True)
    )
    if not is_authority:
        # Workers and schedulers answer and call.
        both_ends = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        builder = builder.add_extension(x509.ExtendedKeyUsage(both_ends), False)
        alternatives = x509.SubjectAlternativeName(map(alternative, names))
        builder = builder.add_extension(alternatives, False)
    return builder.sign(authority_key, hashes.SHA256())


def _write(folder: Path, part: str, certificate: Any, key: Any) -> list[Path]:
    from cryptography.hazmat.primitives import serialization

    text = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    files = [folder / f"{part}.pem", folder / f"{part}-key.pem"]
    contents = (certificate.public_bytes(serialization.Encoding.PEM), text)
    for file, content in zip(files, contents, strict=True):
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as out:
            out.write(content)
    return files
