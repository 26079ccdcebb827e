"""The command `hertzloop node keys`: certificates and configurations for a run on several hosts."""

import ipaddress
import json
import os
import re
from pathlib import Path
from typing import Annotated

import typer

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.cli import options
from hertzloop.cli.terminal import fail, out
from hertzloop.common.atomic_files import write_together
from hertzloop.common.optional_dependencies import need
from hertzloop.processes.program import BASE_PORT


def keys(
    folder: Annotated[Path, typer.Argument(metavar="DIR")],
    hosts: Annotated[str, typer.Option(metavar="plant=A,controller=B,recorder=C")],
    days: Annotated[int, typer.Option(min=1, max=36500)] = 365,
) -> None:
    """Write certificates for a run on several hosts.

    The folder gets a configuration for each role, with certificates that keep everybody else off
    the bus.

    Args:
        folder: New folder for the certificates.
        hosts: Assign a host to each role, with or without a port.
        days: Limit the validity of the certificates to this time, days.
    """
    places = _places(hosts)
    need("cryptography")
    from hertzloop.certificates import CertificateAuthority, configurations

    if os.path.isdir(folder) and any(folder.iterdir()):
        fail(
            f"DIR = {folder}: the folder is not empty, and keys are never replaced. "
            "Choose another folder."
        )
    options.make_folder(folder)
    authority = CertificateAuthority(days)
    texts = {
        f"{role}.json5": json.dumps(configuration, indent=1)
        for role, configuration in configurations(authority, places).items()
    } | {"authority.pem": authority.pem(), "authority.key": authority.key_pem()}
    # Nobody else can read them, from the first byte on.
    write_together({folder / name: f"{text}\n" for name, text in texts.items()}, mode=0o600)
    words = {PLANT: "plant SCENE", CONTROLLER: "controller", RECORDER: "recorder --out F.mcap"}
    out.print(f"Valid for {days} days. Copy one file to each host, and start there:")
    for role, (host, _) in places.items():
        out.say(f"  {host}: hertzloop node {words[role]} --zenoh-config {role}.json5")
    out.say(
        f"Who has one of these files is that role; {folder / 'authority.key'} can make more: it "
        "stays here."
    )


_EXAMPLE = "plant=10.0.0.1,controller=10.0.0.2,recorder=10.0.0.3"
_NAME = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(\.(?!-)[A-Za-z0-9-]{1,63})*")


def _places(hosts: str) -> dict[str, tuple[str, int]]:
    """Host and port of every role, in the order of roles."""
    places: dict[str, tuple[str, int]] = {}
    for word in hosts.split(","):
        role, _, where = word.strip().partition("=")
        if role not in ROLES:
            fail(f"--hosts = '{word}': invalid entry. Write ROLE=HOST for each role: {_EXAMPLE}.")
        if role in places:
            fail(f"--hosts: the {role} is given twice. Remove one entry.")
        places[role] = _place(role, where, BASE_PORT + ROLES.index(role))
    if missing := [role for role in ROLES if role not in places]:
        fail(f"--hosts lacks the {' and the '.join(missing)}; write {_EXAMPLE}")
    ordered = {role: places[role] for role in ROLES}
    if len(set(ordered.values())) < len(ordered):
        fail("--hosts: two roles have the same host and port. Give each role its own port.")
    return ordered


def _bare(host: str) -> str:
    return host[1:-1] if host.startswith("[") and host.endswith("]") else host


def _place(role: str, where: str, port: int) -> tuple[str, int]:
    """Host and port in `where`: an address or a name, with a port or not."""
    try:
        return str(ipaddress.ip_address(_bare(where))), port
    except ValueError:
        host, colon, digits = where.rpartition(":")
    if colon:
        if not digits.isdecimal() or not 0 < int(digits) <= options.LARGEST_PORT:
            said = f"it is a number to {options.LARGEST_PORT}"
            fail(f"--hosts has the port '{digits}' for the {role}; {said}")
        where, port = _bare(host), int(digits)
    try:
        return str(ipaddress.ip_address(where)), port
    except ValueError:
        pass
    if not _NAME.fullmatch(where) or where.replace(".", "").isdecimal():
        fail(f"--hosts = '{where}': invalid host for the {role}. Give an address or a host name.")
    return where, port
