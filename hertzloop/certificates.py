"""Certificates for a bus across hosts: an authority of its own, and one for each role."""

import base64
import datetime
import ipaddress
from collections.abc import Mapping

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from hertzloop.bus.access_control import common_name, secured

_EARLIER = datetime.timedelta(days=1)  # hosts' clocks differ


class CertificateAuthority:
    """Signs certificates, valid for `days` from now."""

    def __init__(self, days: int) -> None:
        self._begin = datetime.datetime.now(datetime.UTC) - _EARLIER
        self._end = self._begin + _EARLIER + datetime.timedelta(days=days)
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = _named("hertzloop authority")
        self._certificate = (
            self._draft(self._name, self._key)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(signs_others=True), critical=True)
            .sign(self._key, hashes.SHA256())
        )

    def _draft(
        self, subject: x509.Name, key: ec.EllipticCurvePrivateKey
    ) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(self._name)
            .public_key(key.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(self._begin)
            .not_valid_after(self._end)
        )

    def pem(self) -> str:
        """Its own certificate, which every host has to know."""
        return _pem(self._certificate)

    def key_pem(self) -> str:
        """Its private key: who has it lets anybody in."""
        return _key_pem(self._key)

    def certificate(self, common_name: str, host: str) -> tuple[str, str]:
        """Certificate for whoever is at `host` (an address or a name), and its private key, PEM."""
        key = ec.generate_private_key(ec.SECP256R1())
        both = [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
        signed = (
            self._draft(_named(common_name), key)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(signs_others=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(both), critical=False)
            .add_extension(x509.SubjectAlternativeName([_place(host)]), critical=False)
            .sign(self._key, hashes.SHA256())
        )
        return _pem(signed), _key_pem(key)


def configurations(
    authority: CertificateAuthority, places: Mapping[str, tuple[str, int]]
) -> dict[str, dict[str, object]]:
    """A zenoh configuration for every role at its host and port, each with a certificate."""
    endpoints = {role: f"tls/{_joined(*place)}" for role, place in places.items()}
    found = {}
    for role, (host, _) in places.items():
        pair = authority.certificate(common_name(role), host)
        texts = [in_base64(pem) for pem in (*pair, authority.pem())]
        found[role] = secured(role, endpoints, *texts)
    return found


def _joined(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def in_base64(pem: str) -> str:
    """A PEM text as a zenoh configuration holds it."""
    return base64.b64encode(pem.encode()).decode()


def _named(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _place(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _usage(signs_others: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_others,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=signs_others,
        crl_sign=signs_others,
        encipher_only=False,
        decipher_only=False,
    )


def _pem(certificate: x509.Certificate) -> str:
    return certificate.public_bytes(serialization.Encoding.PEM).decode()


def _key_pem(key: ec.EllipticCurvePrivateKey) -> str:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    ).decode()
