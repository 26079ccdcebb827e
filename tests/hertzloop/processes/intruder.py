"""A program that wants in: hears all that it can, says all that it can, as every role.

`python -m tests.hertzloop.processes.intruder CONFIG NAME` prints a line when it has begun and one
when it is linked to somebody; when its input ends, what it heard from others, as JSON.
"""

import json
import sys
import threading

import zenoh

from hertzloop.bus.streams import STREAMS, SUBSCRIPTIONS

_EVERY_S = 0.002


def main(file: str, name: str) -> None:
    """Until the input ends."""
    heard: list[str] = []
    seen: list[str] = []
    over = threading.Event()

    def wait_for_end() -> None:
        sys.stdin.read()
        over.set()

    threading.Thread(target=wait_for_end, daemon=True).start()
    root = f"hertzloop/{name}"
    try:
        session = zenoh.open(zenoh.Config.from_file(file))
    except zenoh.ZError as error:
        print(json.dumps({"refused": str(error)}), flush=True)
        over.wait()
        print(json.dumps({"links": 0, "heard": [], "tokens": [], "said": 0}))
        return
    mine = str(session.zid())
    with session:
        remote = zenoh.Locality.REMOTE
        ears = [
            session.declare_subscriber(
                key, lambda s: heard.append(str(s.key_expr)), allowed_origin=remote
            )
            for key in ("**", *(f"{root}/{stream}" for stream in STREAMS))
        ]
        evil = {f"{root}/alive/{role}/evil" for role in SUBSCRIPTIONS}
        eyes = session.liveliness().declare_subscriber(
            "**", lambda s: seen.append(str(s.key_expr)), history=True
        )
        tokens: list[zenoh.LivelinessToken] = []
        print(json.dumps({"begun": mine}), flush=True)
        links, said = 0, 0
        while not over.wait(_EVERY_S):
            here = len(session.info.peers_zid())
            if here and not links:
                print(json.dumps({"linked": here}), flush=True)
            links = max(links, here)
            tokens = tokens or [session.liveliness().declare_token(key) for key in evil]
            for stream in STREAMS:
                session.put(f"{root}/{stream}", b"evil", attachment=bytes(8))
                said += 1
        others = sorted({key for key in seen if key not in evil})
        print(json.dumps({"links": links, "heard": heard, "tokens": others, "said": said}))
        del ears, eyes, tokens


if __name__ == "__main__":
    main(*sys.argv[1:])
