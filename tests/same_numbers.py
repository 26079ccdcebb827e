"""Compare what this checkout and another print: `python -m tests.same_numbers FOLDER`.

Runs `run`, `margin` and `budget --quick` on each shipped scene, and a fit, with the code of both
checkouts. Prints the lines that differ, without numbers that depend on the wall clock.
"""

import argparse
import difflib
import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from hertzloop.scene.loading import shipped

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "docs" / "examples"
FIT = ["fit", "bench.toml", "bench-force.csv", "bench-velocity.csv"]
FREE = ["--free", "contact.limiting_pressure_pa", "--free", "plate.thickness_m"]
WALL_TIME = re.compile(
    r"[\d.]+ times as long \(measured\)|[\d.]+ times real time|[\d,]+ steps/s|in [\d.e-]+ s\b|"
    r"[\d.,]+ (?:s\b|ms\b|us a step|cases a second)"
)


def commands() -> list[list[str]]:
    """Return the commands, as lists of words after `hertzloop`."""
    record = ["--transport", "compiled", "--details", "--overwrite", "--out", "a.mcap"]
    return [
        *(["run", scene, *record] for scene in shipped()),
        *(["margin", scene] for scene in shipped()),
        *(["budget", scene, "--quick"] for scene in shipped()),
        [FIT[0], *(str(EXAMPLES / name) for name in FIT[1:]), *FREE],
    ]


def printed(checkout: Path, words: list[str], folder: Path) -> list[str]:
    """Run a command with the code of a checkout; return its exit code and its lines."""
    done = subprocess.run(
        [sys.executable, "-m", "hertzloop", *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(checkout), "COLUMNS": "200"},
        capture_output=True,
        text=True,
        check=False,
    )
    text = re.sub(r"[┏━┳┓┃┡╇┩│└─┴┘]", " ", WALL_TIME.sub("", done.stdout))
    lines = (" ".join(line.split()) for line in text.splitlines())
    return [f"exit code {done.returncode}", *(line for line in lines if line)]


def main() -> None:
    """Print the lines that differ, and their number; exit with 1 if there are any."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path, help="folder of the other checkout")
    before = parser.parse_args().before.resolve()
    lines = different = 0
    with TemporaryDirectory() as name:
        for words in commands():
            this, other = (printed(root, words, Path(name)) for root in (ROOT, before))
            changes = [
                line
                for line in difflib.unified_diff(other, this, "before", "now", n=0, lineterm="")
                if line[:1] in "+-" and line[:3] not in ("+++", "---")
            ]
            lines, different = lines + len(this), different + len(changes)
            print(" ".join(words[:2]), f"{len(this)} lines, {len(changes)} differ", flush=True)
            print("\n".join(changes), end="\n" if changes else "")
    print(f"{different} of {lines} printed lines differ.")
    sys.exit(different > 0)


if __name__ == "__main__":
    main()
