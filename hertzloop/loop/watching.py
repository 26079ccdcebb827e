"""Somebody who only watches: hears a run on the bus, and is none of its roles.

What a watcher does not take in time is dropped, so that it never slows the run.
"""

import json
import queue
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

import zenoh

from bus.port import PeerLost
from bus.streams import PLANT

_ENDS = f"end/{PLANT}"
_RETURNS_S = 2.0  # for a link that was closed to be there again: zenoh tries ten times a second


def session(connect: Sequence[str]) -> zenoh.Session:
    """A session that is no role's, linked to these endpoints once they are there.

    Raises zenoh.ZError.
    """
    config = zenoh.Config()
    for key, value in {
        "mode": "peer",
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "listen/endpoints": [],
        "connect/endpoints": list(connect),
        "connect/timeout_ms": -1,  # for as long as it takes
        "connect/exit_on_failure": False,
        "connect/retry": {"period_init_ms": 50, "period_max_ms": 100, "period_increase_factor": 2},
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def blocks(name: str, connect: Sequence[str], beside: bool = False) -> Iterator[bytes]:
    """Blocks of truth of the run `name` as they come, until the plant ends; `beside` the run that
    started this process, also when that is gone: standard input ends then.

    Raises zenoh.ZError, and PeerLost when the plant has left without its end, or that was missed.
    """
    inbox: queue.SimpleQueue[bytes | PeerLost | None] = queue.SimpleQueue()
    away: list[threading.Timer] = []  # of a plant that was there

    def on_life(sample: zenoh.Sample) -> None:
        while away:
            away.pop().cancel()
        if sample.kind != zenoh.SampleKind.PUT:
            lost = PeerLost(f"the {PLANT} left the run; its end was not heard", PLANT)
            away.append(threading.Timer(_RETURNS_S, inbox.put, [lost]))
            away[0].daemon = True
            away[0].start()

    def follow_parent() -> None:
        sys.stdin.read()
        inbox.put(None)

    if beside:  # of anybody else standard input says nothing: /dev/null has ended from the start
        threading.Thread(target=follow_parent, daemon=True).start()
    with session(connect) as joined:
        root = f"hertzloop/{name}"
        living = zenoh.handlers.Callback(on_life, indirect=False)
        kept = [
            joined.declare_subscriber(f"{root}/truth", lambda s: inbox.put(s.payload.to_bytes())),
            joined.declare_subscriber(f"{root}/{_ENDS}", lambda _: inbox.put(None)),
            joined.liveliness().declare_subscriber(f"{root}/alive/{PLANT}/*", living, history=True),
        ]
        while (payload := inbox.get()) is not None:
            if isinstance(payload, PeerLost):
                raise payload
            yield payload
        kept.clear()


@contextmanager
def watched(name: str, endpoints: Sequence[str]) -> Iterator[None]:
    """A process beside a run that shows it; whatever becomes of it, the run goes on."""
    words = [word for url in endpoints for word in ("--connect", url)]
    process = subprocess.Popen(
        [sys.executable, "-P", "-m", "hertzloop", "watch", "--machine", "--name", name, *words],
        stdin=subprocess.PIPE,  # never written to: closed, however the run ends
        start_new_session=True,
    )
    try:
        yield
    finally:
        # It ends by itself when it has shown what came, or stays for as long as its viewer.
        assert process.stdin is not None
        with suppress(OSError):
            process.stdin.close()
