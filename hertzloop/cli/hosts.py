"""What several hosts need to hear each other, and nobody else: written by `keys DIR --hosts`."""

import ipaddress
import json
import os
import re
from pathlib import Path

from hertzloop.bus.streams import CONTROLLER, PLANT, RECORDER, ROLES
from hertzloop.cli.options import LARGEST_PORT, fail, make_folder, out

_EXAMPLE = "plant=10.0.0.1,controller=10.0.0.2,recorder=10.0.0.3"
_NAME = re.compile(r"(?!-)[A-Za-z0-9-]{1,63}(\.(?!-)[A-Za-z0-9-]{1,63})*")


def write_keys(folder: Path, hosts: str, days: int) -> None:
    """Write an authority and a configuration for each role into `folder`, which has to be empty;
    ends the command for hosts that are none."""
    from hertzloop.extras import need

    places = _places(hosts)
    need("cryptography")
    from hertzloop.certificates import Authority, configurations

    if os.path.isdir(folder) and any(folder.iterdir()):
        fail(
            f"the folder {folder} is not empty; keys are never replaced, since hosts with the old "
            "ones would be left out without a word: choose another",
            2,
        )
    make_folder(folder)
    authority = Authority(days)
    for role, configuration in configurations(authority, places).items():
        _write(folder / f"{role}.json5", json.dumps(configuration, indent=1))
    _write(folder / "authority.pem", authority.pem())
    _write(folder / "authority.key", authority.key_pem())
    words = {PLANT: "plant SCENE", CONTROLLER: "controller", RECORDER: "record --out F.mcap"}
    out.print(f"Valid for {days} days. Copy one file to each host, and start there:")
    for role, (host, _) in places.items():
        out.print(f"  {host}: hertzloop {words[role]} --zenoh-config {role}.json5", soft_wrap=True)
    out.print(
        f"Who has one of these files is that role; {folder / 'authority.key'} can make more: it "
        "stays here.",
        soft_wrap=True,
    )


def _write(path: Path, text: str) -> None:
    """A new file that nobody else can read, from the first byte on."""
    try:
        with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
            file.write(text + "\n")
    except OSError as error:
        fail(f"cannot write {path}: {error.strerror}", 1)


def _places(hosts: str) -> dict[str, tuple[str, int]]:
    """Host and port of every role, in the order of roles."""
    from hertzloop.processes.roles import BASE_PORT

    places: dict[str, tuple[str, int]] = {}
    for word in hosts.split(","):
        role, _, where = word.strip().partition("=")
        if role not in ROLES:
            fail(f"--hosts has '{word}'; write ROLE=HOST for each role: {_EXAMPLE}", 2)
        if role in places:
            fail(f"--hosts has the {role} twice; a run has one", 2)
        places[role] = _place(role, where, BASE_PORT + ROLES.index(role))
    if missing := [role for role in ROLES if role not in places]:
        fail(f"--hosts lacks the {' and the '.join(missing)}; write {_EXAMPLE}", 2)
    ordered = {role: places[role] for role in ROLES}
    if len(set(ordered.values())) < len(ordered):
        fail("--hosts gives two roles the same host and port; a port has one listener", 2)
    return ordered


def _bare(host: str) -> str:
    """A host without the brackets that an IPv6 address may have."""
    return host[1:-1] if host.startswith("[") and host.endswith("]") else host


def _place(role: str, where: str, port: int) -> tuple[str, int]:
    """Host and port in `where`: an address or a name, with a port or not."""
    try:
        return str(ipaddress.ip_address(_bare(where))), port
    except ValueError:
        host, colon, digits = where.rpartition(":")
    if colon:
        if not digits.isdecimal() or not 0 < int(digits) <= LARGEST_PORT:
            said = f"it is a number to {LARGEST_PORT}"
            fail(f"--hosts has the port '{digits}' for the {role}; {said}", 2)
        where, port = _bare(host), int(digits)
    try:
        return str(ipaddress.ip_address(where)), port
    except ValueError:
        pass
    if not _NAME.fullmatch(where) or where.replace(".", "").isdecimal():
        fail(f"--hosts has '{where}' for the {role}; it is an address or the name of a host", 2)
    return where, port
