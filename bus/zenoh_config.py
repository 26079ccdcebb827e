"""What a role's zenoh session is set to, and why.

A dropped or reordered sample would be a wrong result, so messages between the roles wait
under congestion (BLOCK) until the link's patience is over; then zenoh closes the link, and
the departure is reported. That patience is also the longest time for which the death of a
process may stay unheard: where a message waits for its link, zenoh 1.10 can, on closing the
link, wait for that message. Whoever else listens must not make the run wait: to sessions
that are no role's, messages are dropped when they do not take them. zenoh tells sessions
apart by their ids, so a role draws its id from a pool that follows from the run's name.
Multicast scouting and gossip are off: only the given endpoints are open. Shared memory is
off: it pays for large messages only, and leaves segments and handles behind.
"""

import hashlib
import itertools
import json
import os
from collections.abc import Sequence
from pathlib import Path

import zenoh

from bus.port import BusError

_LEASE_MS = 5_000  # how long a hung peer stays unnoticed while nobody waits for it
_IDS_PER_ROLE = 256  # a pool and not one id, so that a second process of a role can say so
_opened = itertools.count()


def _ids(name: str, role: str) -> list[str]:
    """Session ids (hexadecimal) that processes of a role take in the run `name`."""
    words = (f"{name}/{role}/{i}".encode() for i in range(_IDS_PER_ROLE))
    return [
        f"{int.from_bytes(hashlib.blake2b(word, digest_size=15).digest(), 'big'):x}"
        for word in words
    ]


def is_known(name: str, roles: Sequence[str], number: str) -> bool:
    """Whether a session's id (hexadecimal) is one that the roles of the run `name` take."""
    return any(number in _ids(name, role) for role in roles)


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
        said = json.loads(config.get_json(f"{kind}/endpoints")) or []
        by_mode = list(said.values()) if isinstance(said, dict) else [said]
        named += [endpoint for endpoints in by_mode for endpoint in endpoints or []]
    return named


def _read(config_file: Path) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(str(config_file))
    except zenoh.ZError as error:
        why = str(error).split(" at /")[0]
        raise BusError(f"{config_file} is no zenoh configuration: {why}") from error


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
        "transport/link/tx/lease": _LEASE_MS,
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
