"""Compare the numbers of this checkout with another's: `python -m tests.same_numbers FOLDER`.

Runs each command of `scenes/commands.txt` with the code of both, and compares by name the numbers
of its JSON and the samples of its recording, or the cases of its sweep. Prints each name that
differs with its largest relative difference, and the names that only one of them has.
"""

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow.parquet as pq

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "tests" / "scenes"
# Wall time, versions, and residuals, which are nothing but rounding.
IGNORED = re.compile(
    r"wall|real_time|realtime|seconds|waited|measured|residual|run_id|hertzloop|recording|digest|^file|"
    r"cases_per_s"
)


def commands() -> list[list[str]]:
    """Return the commands, as lists of words after `hertzloop`."""
    lines = (SCENES / "commands.txt").read_text(encoding="utf-8").splitlines()
    found = []
    for words in (line.split() for line in lines if line and not line.startswith("#")):
        folder = SCENES / words[1]
        if folder.is_dir():
            scenes = [p for p in sorted(folder.glob("*.toml")) if "[run]" in p.read_text("utf-8")]
            found += [[words[0], str(p.relative_to(SCENES)), *words[2:]] for p in scenes]
        else:
            found.append(words)
    return found


def values_of(checkout: Path, words: list[str], folder: Path) -> dict[str, Any]:
    """Run a command with the code of a checkout; return its numbers and columns by name."""

    def hertzloop(*args: str) -> int:
        command = [sys.executable, "-m", "hertzloop", *args]
        path = {**os.environ, "PYTHONPATH": str(checkout)}
        done = subprocess.run(command, cwd=folder, env=path, capture_output=True, text=True)
        if done.returncode:
            print(f"{checkout}: {' '.join(args)}\n{done.stderr.strip()}", file=sys.stderr)
        return done.returncode

    results, recording, table = (folder / f"out.{end}" for end in ("json", "mcap", "parquet"))
    for path in (results, recording, table):
        path.unlink(missing_ok=True)
    words = [word.replace("{root}", str(checkout)) for word in words]
    run = ["--transport", "compiled", "--out", recording.name]
    more = {"run": run, "sweep": ["--out", table.name]}.get(words[0], [])
    found: dict[str, Any] = {"exit code": hertzloop(*words, *more, "--json", results.name)}
    if results.exists():
        flatten(json.loads(results.read_text("utf-8")), "", found)
    if recording.exists():
        hertzloop("export", recording.name, "-o", table.name)
    if table.exists():
        for name, column in pq.read_table(table).to_pandas().items():
            if not IGNORED.search(str(name)) and column.dtype.kind in "iuf":
                found[f"table/{name}"] = column.to_numpy(float)
    return found


def flatten(value: Any, path: str, found: dict[str, Any]) -> None:
    """Collect the numbers, truths and words of nested JSON by path; named items by their name."""
    if isinstance(value, dict):
        for key, item in value.items():
            flatten(item, f"{path}/{key}" if path else key, found)
    elif isinstance(value, list):
        for number, item in enumerate(value):
            named = item if isinstance(item, dict) else {}
            name = named.get("name", named.get("metric", number))
            flatten(item, f"{path}/{named.get('span', '')} {name}", found)
    elif not IGNORED.search(path) and not (isinstance(value, str) and " " in value):
        found[path] = value


def difference(now: Any, before: Any) -> float:
    """Return the difference relative to the largest value; infinite where only one is a number."""
    if isinstance(now, str | bool | None) or isinstance(before, str | bool | None):
        return 0.0 if now == before else math.inf
    now, before = np.atleast_1d(now), np.atleast_1d(before)
    if now.shape != before.shape or (np.isnan(now) != np.isnan(before)).any():
        return math.inf
    if np.array_equal(now, before, equal_nan=True):
        return 0.0
    return float(np.nanmax(abs(now - before)) / max(np.nanmax(abs(now)), np.nanmax(abs(before))))


def main() -> int:
    """Exit code: 1 if a number differs, or only one checkout has it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path, help="folder of the other checkout")
    parser.add_argument("--only", default="", help="compare the commands that contain this text")
    options = parser.parse_args()
    roots, both, different = (ROOT, options.before.resolve()), 0, 0
    with TemporaryDirectory() as name, ThreadPoolExecutor(2) as pool:
        folders = [Path(name) / side for side in ("now", "before")]
        for folder in folders:
            shutil.copytree(SCENES, folder)
        for words in (words for words in commands() if options.only in " ".join(words)):
            now, before = pool.map(values_of, roots, [words, words], folders)
            print(" ".join(words), len(now), "names", flush=True)
            told = [f"only now: {path}" for path in now.keys() - before.keys()]
            told += [f"only before: {path}" for path in before.keys() - now.keys()]
            for path in now.keys() & before.keys():
                if worst := difference(now[path], before[path]):
                    told.append(f"{worst:.1e}  {path}")
            both, different = both + len(now.keys() & before.keys()), different + len(told)
            for one in sorted(told):
                print(f"  {one}", flush=True)
    print(f"{both} names in both, {different} differences")
    return int(different > 0)


if __name__ == "__main__":
    sys.exit(main())
