"""The certificates of a fleet: one authority, and a certificate for each part that it signs.

Dask checks that both ends have a certificate of the authority, and nothing else: not names, and
not roles. So every holder of a certificate is trusted as much as any other.
"""

from __future__ import annotations

import datetime
import os
from pathlib import Path
from typing import Any, Final

from r2bspec.fleet.errors import FleetNotInstalledError, InsecureFleetError

PARTS: Final = ("scheduler", "worker", "client")
_YEARS: Final = 2
_DAY: Final = datetime.timedelta(days=1)


def make_certificates(folder: Path, names: tuple[str, ...] = ()) -> list[Path]:
    """Make an authority, and certificates for scheduler, workers and clients; returns the files.

    Args:
        folder: for the files, new or empty. The key of the authority, ``ca-key.pem``, is only
            needed to make further certificates, and belongs off the network.
        names: host names and addresses for the certificates.

    Raises:
        FleetNotInstalledError: the package `cryptography` is missing.
        InsecureFleetError: the folder has files, whose keys may be in use.
    """
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError as error:
        raise FleetNotInstalledError(
            "certificates need the package cryptography, which is not installed",
            hint="pip install 'r2bspec[fleet]', or make them with another tool.",
        ) from error
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    if any(folder.iterdir()):
        raise InsecureFleetError(f"{folder} is not empty: its keys may be in use")
    authority_key = ec.generate_private_key(ec.SECP256R1())
    authority = _builder("r2bspec fleet", "r2bspec fleet", authority_key)
    authority = authority.add_extension(x509.BasicConstraints(ca=True, path_length=0), True)
    authority = authority.add_extension(_usage(signs=True), True)
    signed = authority.sign(authority_key, hashes.SHA256())
    made = _write(folder, "ca", signed, authority_key)
    for part in PARTS:
        key = ec.generate_private_key(ec.SECP256R1())
        builder = _builder(f"r2bspec {part}", "r2bspec fleet", key)
        builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), True)
        builder = builder.add_extension(_usage(signs=False), True)
        builder = builder.add_extension(_both_ends(), False)
        builder = builder.add_extension(_names(names or ("localhost", "127.0.0.1")), False)
        made += _write(folder, part, builder.sign(authority_key, hashes.SHA256()), key)
    return made


def _both_ends() -> Any:
    """Workers and schedulers answer and call."""
    from cryptography import x509
    from cryptography.x509.oid import ExtendedKeyUsageOID

    return x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])


def _builder(subject: str, issuer: str, key: Any) -> Any:
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    def name(text: str) -> Any:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(name(subject))
        .issuer_name(name(issuer))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _DAY)  # clocks of robots differ
        .not_valid_after(now + _YEARS * 365 * _DAY)
    )


def _usage(*, signs: bool) -> Any:
    from cryptography import x509

    return x509.KeyUsage(
        digital_signature=not signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs,
        crl_sign=signs,
        encipher_only=False,
        decipher_only=False,
    )


def _names(names: tuple[str, ...]) -> Any:
    import ipaddress

    from cryptography import x509

    found: list[Any] = []
    for each in names:
        try:
            found.append(x509.IPAddress(ipaddress.ip_address(each)))
        except ValueError:
            found.append(x509.DNSName(each))
    return x509.SubjectAlternativeName(found)


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
