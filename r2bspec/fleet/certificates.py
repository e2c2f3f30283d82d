"""The certificates of a fleet: one authority, and a certificate for each part that it signs.

Dask checks that both ends have a certificate of the authority, and nothing else: not names, and
not roles. So every holder of a certificate is trusted as much as any other.
"""

from __future__ import annotations

import datetime
import ipaddress
import os
from pathlib import Path
from typing import Any, Final

from r2bspec.fleet.errors import FleetNotInstalledError, InsecureFleetError

PARTS: Final = ("scheduler", "worker", "client")
_USES: Final = (
    *("digital_signature", "content_commitment", "key_encipherment", "data_encipherment"),
    *("key_agreement", "key_cert_sign", "crl_sign", "encipher_only", "decipher_only"),
)
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
    usual_names = names or ("localhost", "127.0.0.1")
    files = []
    for part in ("ca", *PARTS):
        is_authority = part == "ca"
        key = authority_key if is_authority else ec.generate_private_key(ec.SECP256R1())
        subject = "r2bspec fleet" if is_authority else f"r2bspec {part}"
        builder = _builder(subject, key, is_authority=is_authority)
        if not is_authority:
            builder = builder.add_extension(_both_ends(), False)
            builder = builder.add_extension(_alternatives(usual_names), False)
        files += _write(folder, part, builder.sign(authority_key, hashes.SHA256()), key)
    return files


def _builder(subject: str, key: Any, *, is_authority: bool) -> Any:
    from cryptography import x509
    from cryptography.x509.oid import NameOID

    def name(text: str) -> Any:
        return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])

    now = datetime.datetime.now(datetime.UTC)
    builder = (
        x509.CertificateBuilder()
        .subject_name(name(subject))
        .issuer_name(name("r2bspec fleet"))
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _DAY)  # clocks of robots differ
        .not_valid_after(now + _YEARS * 365 * _DAY)
    )
    path_length = 0 if is_authority else None
    builder = builder.add_extension(x509.BasicConstraints(is_authority, path_length), True)
    uses = dict.fromkeys(_USES, False)
    uses |= {"key_cert_sign": is_authority, "digital_signature": not is_authority}
    return builder.add_extension(x509.KeyUsage(**uses), True)


def _both_ends() -> Any:
    """Workers and schedulers answer and call."""
    from cryptography import x509
    from cryptography.x509.oid import ExtendedKeyUsageOID

    return x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])


def _alternatives(names: tuple[str, ...]) -> Any:
    from cryptography import x509

    alternatives: list[Any] = []
    for name in names:
        try:
            alternatives.append(x509.IPAddress(ipaddress.ip_address(name)))
        except ValueError:
            alternatives.append(x509.DNSName(name))
    return x509.SubjectAlternativeName(alternatives)


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
