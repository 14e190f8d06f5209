"""Certificates for the network of a lab: an authority, and one certificate for each role.

The private key of the authority is never written to a file: it signs, and is then deleted. So nobody can issue a further
certificate, and a renewal replaces all certificates.

Source: RFC 5280 (certificates), RFC 8446 (TLS 1.3); library `cryptography` of the Python Cryptographic Authority.
"""

import re
from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from ipaddress import ip_address
from typing import NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from protocols.errors import InputError

_CURVE = ec.SECP256R1()  # supported by every TLS library, including that of zenoh (rustls)
_SLACK = timedelta(minutes=5)  # a certificate is valid this much earlier, because the clocks of a lab differ
_AUTHORITY = "clutch-hil lab"
_LABEL = re.compile(r"[A-Za-z0-9]([A-Za-z0-9-]{0,61}[A-Za-z0-9])?")  # a label of a host name (RFC 1123, 2.1)


class Certificate(NamedTuple):
    """A certificate and its private key, both as PEM text."""

    certificate: str
    key: str


class Authority:
    """Authority that signs certificates valid from `begins`, or now, until `expires`, in UTC."""

    def __init__(self, expires: datetime, begins: datetime | None = None) -> None:
        self._begins, self._expires = begins or datetime.now(UTC) - _SLACK, expires
        self._key = ec.generate_private_key(_CURVE)
        self._name = _name(_AUTHORITY)
        builder = self._make_builder(self._name, self._key.public_key())
        builder = builder.add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        builder = builder.add_extension(_make_usage(signs_certificates=True), critical=True)
        self._own = builder.sign(self._key, hashes.SHA256())

    @property
    def certificate(self) -> str:
        """Return the certificate of the authority as PEM text; peers verify its signatures with it."""
        return self._own.public_bytes(Encoding.PEM).decode()

    def issue_certificate(self, name: str, hosts: Sequence[str] = ()) -> Certificate:
        """Make a certificate for `name`: for a server at `hosts`, names or addresses; for a client if there are none."""
        key = ec.generate_private_key(_CURVE)
        purpose = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
        alternatives = x509.SubjectAlternativeName([_parse_host(host) for host in hosts] or [x509.DNSName(name)])
        builder = self._make_builder(_name(name), key.public_key())
        builder = builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        builder = builder.add_extension(_make_usage(signs_certificates=False), critical=True)
        builder = builder.add_extension(x509.ExtendedKeyUsage([purpose]), critical=True)
        builder = builder.add_extension(alternatives, critical=False)
        signed = builder.sign(self._key, hashes.SHA256())
        return Certificate(
            signed.public_bytes(Encoding.PEM).decode(),
            key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()).decode(),
        )

    def _make_builder(self, subject: x509.Name, key: ec.EllipticCurvePublicKey) -> x509.CertificateBuilder:
        return x509.CertificateBuilder(
            issuer_name=self._name,
            subject_name=subject,
            public_key=key,
            serial_number=x509.random_serial_number(),
            not_valid_before=self._begins,
            not_valid_after=self._expires,
        )


def check_host(host: str) -> str:
    """Return `host` if it is an address or a host name. Raises InputError."""
    try:
        _parse_host(host)
    except ValueError:
        raise InputError(
            f"host {host[:60]!r} is not possible; allowed are an address such as 192.168.1.5, or a host's name"
        ) from None
    return host


def _parse_host(host: str) -> x509.GeneralName:
    """Return `host` as a name for a certificate. Raises ValueError for what is neither an address nor a host name."""
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        labels = host.split(".")
        if labels[-1].isdecimal():  # a mistyped address: no host name ends with digits only (RFC 1123, 2.1)
            raise
        if all(map(_LABEL.fullmatch, labels)):
            return x509.DNSName(host)
        raise


def _name(common: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common)])


def _make_usage(signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_certificates,
        crl_sign=False,
        encipher_only=False,
        decipher_only=False,
    )
