"""Connections of a fleet: TLS beyond this machine, and its certificates."""

from __future__ import annotations

import ipaddress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import urlsplit

import msgspec

from r2bspec.fleet.errors import FleetNotInstalledError, InsecureFleetError
from r2bspec.untrusted.safe_file import is_there, read_text
from r2bspec.untrusted.safe_yaml import load_values

if TYPE_CHECKING:
    from distributed.security import Security

_MAX_FILE_BYTES: Final = 100_000
_KEYS: Final = frozenset({"scheduler", "ca", "certificate", "key"})
_SCHEMES: Final = ("tcp", "tls")
_DEFAULT_PORT: Final = 8786


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
        made = Security(  # type: ignore[no-untyped-call]
            tls_ca_file=str(self.ca), require_encryption=True, **roles
        )
        try:
            made.get_connection_args("client")  # type: ignore[no-untyped-call] # reads the files
        except (OSError, ValueError) as error:
            named = ", ".join(map(str, (self.ca, self.certificate, self.key)))
            raise InsecureFleetError(
                f"the certificates cannot be used: {error}",
                hint=f"Their files are {named}; 'r2bspec fleet certificates' makes new ones.",
            ) from error
        return made


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
            raise InsecureFleetError(f"the file of {name}, {path}, does not exist")
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
            logging.getLogger(name).setLevel(logging.CRITICAL)
    logging.getLogger("distributed").setLevel(logging.CRITICAL)


def _with_port(address: str) -> str:
    try:
        parts = urlsplit(address)
        known = parts.scheme in _SCHEMES and bool(parts.hostname)
        port = parts.port
    except ValueError:
        known, port = False, None
    if not known:
        raise InsecureFleetError(
            f"{address!r} is no address of a scheduler",
            hint="An address is tls://HOST:PORT or tcp://HOST:PORT.",
        )
    return address if port is not None else f"{address}:{_DEFAULT_PORT}"


def _read_cluster_file(path: Path) -> dict[str, str]:
    try:
        content = load_values(read_text(path, max_bytes=_MAX_FILE_BYTES))
        found = msgspec.convert(content, dict[str, str])
    except OSError as error:
        raise InsecureFleetError(
            f"{path} is neither an address nor a cluster file that can be read: "
            f"{error.strerror or error}",
            hint="An address is tls://HOST:PORT or tcp://HOST:PORT.",
        ) from error
    except Exception as error:
        raise InsecureFleetError(f"{path} is not a cluster file: {error}") from error
    if unknown := sorted(set(found) - _KEYS):
        raise InsecureFleetError(
            f"{path} has the unknown key {unknown[0]!r}",
            hint=f"Its keys are {', '.join(sorted(_KEYS))}.",
        )
    return found
