"""Observe a run over the bus without being one of its roles.

It drops what its viewer does not take in time. An observer that hangs ends the run, after the
timeout of the run.
"""

import queue
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress

import zenoh

from hertzloop.bus.port import PeerLost
from hertzloop.bus.streams import PLANT
from hertzloop.bus.zenoh_config import session_config

_ENDS = f"end/{PLANT}"
_MOST_WAITING = 1000  # blocks that are not shown yet
_RETURNS_S = 2.0  # for a link that was closed to be there again: zenoh tries twice a second
_LINK_S = 60.0  # for a silent link to be closed


def _session(connect: Sequence[str]) -> zenoh.Session:
    """Open a session that belongs to no role, linked to these endpoints once they exist.

    Raises zenoh.ZError.
    """
    config = session_config([], connect, None, _LINK_S)
    config.insert_json5("connect/timeout_ms", "-1")  # for as long as it takes
    config.insert_json5("connect/exit_on_failure", "false")
    return zenoh.open(config)


def truth_blocks(name: str, connect: Sequence[str], beside: bool = False) -> Iterator[bytes]:
    """Yield blocks of truth of the run `name` as they come, until the plant ends.

    With `beside`, the run started this process: stop as well when standard input ends, since the
    run is gone then.

    Raises zenoh.ZError, and PeerLost when the plant has left without its end, or that was missed.
    """
    inbox: queue.SimpleQueue[bytes | PeerLost | None] = queue.SimpleQueue()
    away: list[threading.Timer] = []  # of a plant that was there

    def on_block(sample: zenoh.Sample) -> None:
        if inbox.qsize() < _MOST_WAITING:
            inbox.put(sample.payload.to_bytes())

    def on_life(sample: zenoh.Sample) -> None:
        while away:
            away.pop().cancel()
        if sample.kind != zenoh.SampleKind.PUT:
            lost = PeerLost(f"the {PLANT} left the run without a final message", PLANT)
            away.append(threading.Timer(_RETURNS_S, inbox.put, [lost]))
            away[0].daemon = True
            away[0].start()

    def follow_parent() -> None:
        sys.stdin.read()
        inbox.put(None)

    if beside:  # of anybody else standard input says nothing: /dev/null has ended from the start
        threading.Thread(target=follow_parent, daemon=True).start()
    with _session(connect) as joined:
        root = f"hertzloop/{name}"
        living = zenoh.handlers.Callback(on_life, indirect=False)
        kept = [
            joined.declare_subscriber(
                f"{root}/truth", zenoh.handlers.Callback(on_block, indirect=False)
            ),
            joined.declare_subscriber(f"{root}/{_ENDS}", lambda _: inbox.put(None)),
            joined.liveliness().declare_subscriber(f"{root}/alive/{PLANT}/*", living, history=True),
        ]
        while (payload := inbox.get()) is not None:
            if isinstance(payload, PeerLost):
                raise payload
            yield payload
        kept.clear()


@contextmanager
def observer_beside(name: str, endpoints: Sequence[str]) -> Iterator[None]:
    """Show a run in a process beside it. The run goes on whatever happens to that process."""
    words = [word for url in endpoints for word in ("--connect", url)]
    process = subprocess.Popen(
        [
            sys.executable,
            "-P",
            "-m",
            "hertzloop",
            "node",
            "watch",
            "--machine",
            "--name",
            name,
            *words,
        ],
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
