"""Self-signed certificates, for access to the page from another machine on the network."""

from __future__ import annotations

import datetime
import ipaddress
import os
from pathlib import Path

from rcdn.errors import DependencyError
from rcdn.io import write_bytes

DAYS = 30


def self_signed(folder: Path, host: str) -> tuple[Path, Path]:
    """Write a certificate for `host` and its key into `folder`, readable by this user only; returns both paths. The
    certificate is valid for 30 days.

    Raises DependencyError without the package cryptography.
    """
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
        from cryptography.x509.oid import NameOID
    except ImportError as error:
        raise DependencyError(
            "--self-signed needs the package cryptography; run: pip install cryptography (or give "
            "--certificate and --key)"
        ) from error
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "rcdn live")])
    now = datetime.datetime.now(datetime.UTC)
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(minutes=5))
        .not_valid_after(now + datetime.timedelta(days=DAYS))
        .add_extension(x509.SubjectAlternativeName([_alternative(x509, host)]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    pem = serialization.Encoding.PEM
    secret = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    paths = (folder / ".certificate.pem", folder / ".key.pem")
    for path, data in zip(paths, (certificate.public_bytes(pem), secret), strict=True):
        if not path.exists():
            os.close(os.open(path, os.O_CREAT | os.O_WRONLY, 0o600))
        write_bytes(path, data)
    return paths


def fingerprint(path: Path) -> str:
    """SHA-256 fingerprint of the certificate in the form shown by browsers, for comparison before trusting it."""
    import hashlib
    import ssl

    der = ssl.PEM_cert_to_DER_cert(path.read_text("ascii"))
    return hashlib.sha256(der).digest().hex(":").upper()


def _alternative(x509, host: str):  # type: ignore[no-untyped-def]
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
