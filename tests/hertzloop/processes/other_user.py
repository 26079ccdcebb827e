"""Another user of this machine, who wants to hear a run and to have a say in it.

`python -m tests.hertzloop.processes.other_user UID NAME ENDPOINT ...`, by root: becomes
that user once all is imported, connects to every socket, and then as zenoh does, hears, and speaks;
prints the errors, and whether it heard something.
"""

import json
import os
import socket
import sys
import time

import zenoh

from hertzloop.bus.streams import STREAMS


def errors(endpoints: list[str]) -> list[str]:
    """Names of what the system raises for connections to Unix sockets."""
    found = []
    for endpoint in endpoints:
        try:
            with socket.socket(socket.AF_UNIX) as one:
                one.connect(endpoint.removeprefix("unixsock-stream/"))
        except OSError as error:
            found.append(type(error).__name__)
    return found


def takes_part(endpoint: str, name: str) -> bool:
    """Whether a session that links to the endpoint hears something of the run; if so it speaks
    until the run is over. (Not before: what it says may end the run before it has heard.)"""
    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "scouting/multicast/enabled": False,
        "connect/timeout_ms": 2000,
        "connect/endpoints": [endpoint],
    }.items():
        config.insert_json5(key, json.dumps(value))
    heard: list[str] = []
    try:
        with zenoh.open(config) as session:
            session.declare_subscriber(
                f"hertzloop/{name}/**",
                lambda sample: heard.append(str(sample.key_expr)),
                allowed_origin=zenoh.Locality.REMOTE,
            )
            while not heard and session.info.peers_zid():
                time.sleep(0.01)
            while session.info.peers_zid():
                for stream in STREAMS:
                    session.put(f"hertzloop/{name}/{stream}", b"evil", attachment=bytes(8))
            return bool(heard)
    except zenoh.ZError:
        return False


if __name__ == "__main__":
    user, name, *endpoints = sys.argv[1:]
    if int(user):
        os.setgroups([])
        os.setgid(int(user))
        os.setuid(int(user))
    print(json.dumps([errors(endpoints), takes_part(endpoints[0], name)]))
