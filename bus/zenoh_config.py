"""What a role's zenoh session is set to, and why.

A dropped or reordered sample would be a wrong result, so messages wait under congestion (BLOCK)
until the run's timeout is over; then zenoh closes the link, and whoever sends says who did not
accept its message. That holds for each subscriber, an observer as well. It is also the longest
time for which the death of a process may stay unheard: where a message waits for its link, zenoh
1.10 can, on closing the link, wait for that message. The lease, after which zenoh closes the link
of a process that sends nothing, is at least as long: a role that hangs is noticed by whoever waits
for it.
Multicast scouting and gossip are off: only the given endpoints are open. Shared memory is
off: it pays for large messages only, and leaves segments and handles behind.
"""

import json
import re
from collections.abc import Sequence
from pathlib import Path

import zenoh

from hertzloop.bus.port import BusError

_LEASE_S = 60.0  # at least: until the loss of a host is noticed that nobody waits for


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
    listen: Sequence[str], connect: Sequence[str], config_file: Path | None, timeout_s: float
) -> zenoh.Config:
    """Return the configuration of a role's session.

    Args:
        listen: Endpoints to listen on; they replace those of the file.
        connect: Endpoints to connect to; they replace those of the file.
        config_file: A zenoh configuration.
        timeout_s: How long a message may wait for a subscriber that does not accept it.

    Raises:
        BusError: The file is no configuration.
    """
    config = _read(config_file) if config_file else zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": int(max(_LEASE_S, timeout_s) * 1e3),
        "transport/link/tx/queue/congestion_control": {
            "block": {"wait_before_close": int(timeout_s * 1e6)},
        },
        "connect/retry": {"period_init_ms": 20, "period_max_ms": 500, "period_increase_factor": 2},
    }
    for kind, endpoints in (("listen", listen), ("connect", connect)):
        # zenoh's own default is to listen on every interface.
        if endpoints or not config_file or not names_endpoints(config_file, kind):
            settings[f"{kind}/endpoints"] = list(endpoints)
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config
