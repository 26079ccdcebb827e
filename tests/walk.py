"""The way of a run through the files: every function once, in the order of the first calls.

    python -m tests.walk

A stay is a visit to a file. A return is a stay in a file that was visited before.
"""

import json
import os
import sys
import tempfile
import threading
from contextlib import redirect_stdout
from itertools import groupby
from pathlib import Path
from types import CodeType, FrameType

HOME = Path(__file__).resolve().parents[1]
FOLDERS = tuple(
    f"{HOME / name}{os.sep}"
    for name in ("hertzloop", "plant", "sensors", "controller", "bus", "recordings")
)
RUN = ["run", "aluminium-20mm", "--transport", "compiled", "--set", "run.duration_s=0.005"]


def walked() -> list[tuple[str, str]]:
    """File and name of each function of a run in this process, imports included."""
    seen: set[CodeType] = set()
    found: list[tuple[str, str]] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or code in seen:
            return
        seen.add(code)
        file = os.path.realpath(code.co_filename)
        if file.startswith(FOLDERS) and not code.co_name.startswith("<"):
            found.append((os.path.relpath(file, HOME), code.co_qualname))

    with tempfile.TemporaryDirectory() as folder:
        sys.argv = ["hertzloop", *RUN, "--out", f"{folder}/a.mcap"]
        threading.setprofile(note)
        sys.setprofile(note)
        try:
            from hertzloop.__main__ import main

            main()
        except SystemExit as ended:
            if ended.code:
                raise
        finally:
            sys.setprofile(None)
            threading.setprofile(None)  # type: ignore[arg-type]
    return found


def main() -> None:
    """Print the stays, then their number, that of the files and that of the returns, as JSON."""
    with open(os.devnull, "w") as nowhere, redirect_stdout(nowhere):
        found = walked()
    stays = [(file, [name for _, name in some]) for file, some in groupby(found, lambda f: f[0])]
    for file, names in stays:
        print(f"{file}: {' '.join(names)}")
    files = len({file for file, _ in stays})
    print(json.dumps({"stays": len(stays), "files": files, "returns": len(stays) - files}))


if __name__ == "__main__":
    main()
