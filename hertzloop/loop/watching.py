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

_ENDS = "end/plant"


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
    started this process, also when that is gone: standard input ends then. Raises zenoh.ZError."""
    inbox: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()

    def follow_parent() -> None:
        sys.stdin.read()
        inbox.put(None)

    if beside:  # of anybody else standard input says nothing: /dev/null has ended from the start
        threading.Thread(target=follow_parent, daemon=True).start()
    with session(connect) as joined:
        root = f"hertzloop/{name}"
        kept = [
            joined.declare_subscriber(f"{root}/truth", lambda s: inbox.put(s.payload.to_bytes())),
            joined.declare_subscriber(f"{root}/{_ENDS}", lambda _: inbox.put(None)),
        ]
        while (payload := inbox.get()) is not None:
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
