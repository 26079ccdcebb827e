"""What a role's zenoh session is set to, and why.

A dropped or reordered sample would be a wrong result, so messages between the roles wait
under congestion (BLOCK) until the link's patience is over; then zenoh closes the link, and
the departure is reported. That patience is also the longest time for which the death of a
process may stay unheard: where a message waits for its link, zenoh 1.10 can, on closing the
link, wait for that message. zenoh's times go on while all processes are stopped. So a process
with a launcher has patience without limit, and the launcher ends a run of which a process does
not react. The lease, after which zenoh closes the link of a process that sends nothing, is at
least as long: a role that hangs is noticed by whoever waits for it. Whoever else listens must
not make the run wait: to sessions that are no role's, messages are dropped when they do not
take them. zenoh tells sessions apart by their ids, so a role draws its id from a pool that
follows from the run's name, and from a secret (HERTZLOOP_RUN_KEY) that a launcher gives its
processes: nobody else can guess it.
Multicast scouting and gossip are off: only the given endpoints are open. Shared memory is
off: it pays for large messages only, and leaves segments and handles behind.
"""

import hashlib
import itertools
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path

import zenoh

from hertzloop.bus.port import BusError
from hertzloop.bus.sockets import RUN_KEY
from hertzloop.bus.streams import ROLES

_LEASE_S = 60.0  # at least: until the loss of a host is noticed that nobody waits for
_IDS_PER_ROLE = 256  # a pool and not one id, so that a second process of a role can say so
_opened = itertools.count()
_key = ""


def _secret() -> str:
    """Take the secret out of the environment: programs that this process starts do not get it."""
    global _key
    _key = os.environ.pop(RUN_KEY, _key)
    return _key


def _ids(name: str, role: str) -> list[str]:
    """Session ids (hexadecimal) that processes of a role take in the run `name`."""
    words = (f"{_secret()}{name}/{role}/{i}".encode() for i in range(_IDS_PER_ROLE))
    return [
        f"{int.from_bytes(hashlib.blake2b(word, digest_size=15).digest(), 'big'):x}"
        for word in words
    ]


def role_of(name: str, number: str) -> str:
    """Role of the run `name` that takes this session id (hexadecimal); "" if none does."""
    return next((role for role in ROLES if number in _ids(name, role)), "")


def _rules(name: str, roles: Sequence[str]) -> list[dict[str, object]]:
    """Messages are dropped to whom they block, except to the roles: the last rule wins."""
    common = {"messages": ["put"], "key_exprs": [f"hertzloop/{name}/**"], "flows": ["egress"]}
    known = [number for role in roles for number in _ids(name, role)]
    return [
        {"id": "anybody", **common, "overwrite": {"congestion_control": "drop"}},
        {"id": "roles", "zids": known, **common, "overwrite": {"congestion_control": "block"}},
    ]


def names_endpoints(config_file: Path, kind: str) -> bool:
    """Whether a configuration file says where to "listen" or "connect".

    Raises BusError for a file that is no configuration.
    """
    key = f"{kind}/endpoints"
    return bool(_read(config_file).get_json(key) != zenoh.Config().get_json(key))


def endpoints_named(config_file: Path) -> list[str]:
    """All endpoints of a configuration file, for whatever mode; zenoh's own where it names none.

    Raises BusError for a file that is no configuration.
    """
    config, named = _read(config_file), []
    for kind in ("listen", "connect"):
        endpoints = json.loads(config.get_json(f"{kind}/endpoints")) or []
        by_mode = list(endpoints.values()) if isinstance(endpoints, dict) else [endpoints]
        named += [endpoint for endpoints in by_mode for endpoint in endpoints or []]
    return named


def _read(config_file: Path) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(str(config_file))
    except zenoh.ZError as error:
        # The text of the error quotes the file, which may hold a private key.
        at = re.search(r"--> (\d+):|line: (\d+)", str(error))
        why = f"line {at[1] or at[2]} is wrong. Correct it." if at else "it cannot be read."
        raise BusError(f"{config_file}: is not a zenoh configuration: {why}") from None


def session_config(
    role: str,
    roles: Sequence[str],
    name: str,
    listen: Sequence[str],
    connect: Sequence[str],
    config_file: Path | None,
    patience_s: float,
) -> zenoh.Config:
    """Configuration of a role's session; a file adds to it, given endpoints replace its own.

    `patience_s` is how long a message may wait for a role that does not take it. Raises
    BusError for a file that is no configuration.
    """
    config = _read(config_file) if config_file else zenoh.Config()
    settings: dict[str, object] = {
        "id": _ids(name, role)[(os.getpid() + next(_opened)) % _IDS_PER_ROLE],
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": int(max(_LEASE_S, patience_s) * 1e3),
        "transport/link/tx/queue/congestion_control": {
            "block": {"wait_before_close": int(patience_s * 1e6)},
            "drop": {"wait_before_drop": 0, "max_wait_before_drop_fragments": 0},
        },
        "qos/network": _rules(name, roles),
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 500, "period_increase_factor": 2},
    }
    for kind, endpoints in (("listen", listen), ("connect", connect)):
        # zenoh's own default is to listen on every interface.
        if endpoints or not config_file or not names_endpoints(config_file, kind):
            settings[f"{kind}/endpoints"] = list(endpoints)
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
