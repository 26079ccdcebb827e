"""The command `node keys`: certificates and configurations for a run on several hosts."""

import ipaddress
import json
import os
import re
from pathlib import Path
from typing import Annotated

import typer

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.cli import outputs
from hertzloop.cli.terminal import fail, out
from hertzloop.common.atomic_files import write_together
from hertzloop.common.optional_dependencies import need
from hertzloop.processes.program import BASE_PORT, LARGEST_PORT


def keys(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="New folder for the certificates.")],
    hosts: Annotated[
        str,
        typer.Option(
            metavar="plant=A,controller=B,recorder=C",
            help="Assign a host to each role, with or without a port.",
        ),
    ],
    days: Annotated[
        int,
        typer.Option(
            min=1, max=36500, help="Limit the validity of the certificates to this time, days."
        ),
    ] = 365,
) -> None:
    """Write certificates for a run on several hosts.

    The folder gets a configuration for each role, with certificates that keep everybody else off
    the bus.
    """
    addresses = _addresses(hosts)
    need("cryptography")
    from hertzloop.certificates import CertificateAuthority, configurations

    if os.path.isdir(folder) and any(folder.iterdir()):
        fail(
            f"DIR = {folder}: the folder is not empty, and keys are never replaced. "
            "Choose another folder."
        )
    outputs.make_folder(folder)
    authority = CertificateAuthority(days)
    texts = {
        f"{role}.json5": json.dumps(configuration, indent=1)
        for role, configuration in configurations(authority, addresses).items()
    } | {"authority.pem": authority.pem(), "authority.key": authority.key_pem()}
    # Nobody else can read them, from the first byte on.
    write_together({folder / name: f"{text}\n" for name, text in texts.items()}, mode=0o600)
    words = {PLANT: "plant SCENE", CONTROLLER: "controller", RECORDER: "recorder --out F.mcap"}
    out.print(f"Valid for {days} days. Copy one file to each host, and start there:")
    for role, (host, _) in addresses.items():
        out.say(f"  {host}: hertzloop node {words[role]} --zenoh-config {role}.json5")
    out.say(
        f"Who has one of these files is that role; {folder / 'authority.key'} can make more: it "
        "stays here."
    )


_EXAMPLE = "plant=10.0.0.1,controller=10.0.0.2,recorder=10.0.0.3"
_NAME = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(\.(?!-)[A-Za-z0-9-]{1,63})*")


def _addresses(hosts: str) -> dict[str, tuple[str, int]]:
    """Return host and port of every role, in the order of the roles."""
    addresses: dict[str, tuple[str, int]] = {}
    for word in hosts.split(","):
        role, _, where = word.strip().partition("=")
        if role not in ROLES:
            fail(f"--hosts = '{word}': invalid entry. Write ROLE=HOST for each role: {_EXAMPLE}.")
        if role in addresses:
            fail(f"--hosts: the {role} is given twice. Remove one entry.")
        addresses[role] = _address(role, where, BASE_PORT + ROLES.index(role))
    if missing := [role for role in ROLES if role not in addresses]:
        fail(f"--hosts lacks the {' and the '.join(missing)}; write {_EXAMPLE}")
    ordered = {role: addresses[role] for role in ROLES}
    if len(set(ordered.values())) < len(ordered):
        fail("--hosts: two roles have the same host and port. Give each role its own port.")
    return ordered


def _without_brackets(host: str) -> str:
    """Return the address of an IPv6 host that is written as [ADDRESS]."""
    return host[1:-1] if host.startswith("[") and host.endswith("]") else host


def _address(role: str, where: str, port: int) -> tuple[str, int]:
    """Return the host in `where`, and its port, or `port` if it names none."""
    try:
        return str(ipaddress.ip_address(_without_brackets(where))), port
    except ValueError:
        host, colon, digits = where.rpartition(":")
    if colon:
        if not digits.isdecimal() or not 0 < int(digits) <= LARGEST_PORT:
            fail(
                f"--hosts has the port '{digits}' for the {role}; it is a number to {LARGEST_PORT}"
            )
        where, port = _without_brackets(host), int(digits)
    try:
        return str(ipaddress.ip_address(where)), port
    except ValueError:
        pass
    if not _NAME.fullmatch(where) or where.replace(".", "").isdecimal():
        fail(f"--hosts = '{where}': invalid host for the {role}. Give an address or a host name.")
    return where, port
