"""Compare the numbers of this checkout with another's: `python -m tests.same_numbers FOLDER`.

Runs each command of `scenes/commands.txt` with the code of both, and compares by name the numbers
of its JSON and the samples of its recording. Prints for each kind of number how many there are, how
many are equal to the bit, and the largest relative difference; and the names that only one has.
The contacts after the first, which may not be predictable, are kinds of their own.
"""

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "tests" / "scenes"
# Wall time, versions, and residuals, which are nothing but rounding.
IGNORED = re.compile(
    r"wall|real_time|realtime|seconds|waited|measured|residual|run_id|hertzloop|recording|digest|^file|"
    r"cases_per_s"
)
LATER = re.compile(r"(impacts|noise|controlled)/[1-9]|whole_run|demand|push|stability")
KINDS = {  # by the end of a name, in this order
    "speed": r"_m_s$|speed(_max)?$",
    "energy": r"_j$|energy$|_w$",
    "force": r"_n$|_n_s$|force$",
    "time": r"_n?u?s$",
    "change": r"_db$|_percent$",
    "pressure": r"_pa$",
    "frequency": r"_hz$",
}


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
        done = subprocess.run(
            [sys.executable, "-m", "hertzloop", *args],
            cwd=folder,
            env={**os.environ, "PYTHONPATH": str(checkout)},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            print(f"{checkout}: {' '.join(args)}\n{done.stderr.strip()}", file=sys.stderr)
        return done.returncode

    results, recording, table = (folder / f"out.{end}" for end in ("json", "mcap", "parquet"))
    for path in (results, recording, table):
        path.unlink(missing_ok=True)
    words = [word.replace("{root}", str(checkout)) for word in words]
    more = {
        "run": ["--transport", "compiled", "--out", recording.name],
        "sweep": ["--out", table.name],
    }.get(words[0], [])
    found: dict[str, Any] = {"exit code": hertzloop(*words, *more, "--json", results.name)}
    if results.exists():
        flatten(json.loads(results.read_text("utf-8")), "", found)
    if recording.exists():
        hertzloop("export", recording.name, "-o", table.name)
    if table.exists():
        second = found.get("impacts/1/start_s", math.inf)
        of_table = pq.read_table(table)
        numeric = [
            f.name
            for f in of_table.schema
            if pa.types.is_integer(f.type) or pa.types.is_floating(f.type)
        ]
        columns = {name: np.asarray(of_table[name], float) for name in numeric}
        if "time_ns" not in columns:  # the cases of a sweep
            return found | {
                f"cases/{name}": column
                for name, column in columns.items()
                if not IGNORED.search(name)
            }
        later = columns["time_ns"] * 1e-9 >= second - 1e-5
        for name, column in columns.items():
            found[f"samples/{name}"] = column[~later]
            found[f"samples/whole_run/{name}"] = column[later]
    return found


def flatten(value: Any, path: str, found: dict[str, Any]) -> None:
    """Collect the numbers, truths and words of nested JSON by path; named items by their name."""
    if isinstance(value, dict):
        for key, item in value.items():
            flatten(item, f"{path}/{key}" if path else key, found)
    elif isinstance(value, list):
        for number, item in enumerate(value):
            name = str(number)
            if isinstance(item, dict):
                name = (
                    f"{item.get('span', '')} {item.get('name', item.get('metric', number))}".strip()
                )
            flatten(item, f"{path}/{name}", found)
    elif not IGNORED.search(path) and not (isinstance(value, str) and " " in value):
        found[path] = value


def difference(now: Any, before: Any) -> float:
    """Return the difference relative to the largest value; infinite where only one is a number."""
    if isinstance(now, str | bool | None) or isinstance(before, str | bool | None):
        return 0.0 if now == before else math.inf
    now, before = np.atleast_1d(now), np.atleast_1d(before)
    if now.shape != before.shape or (np.isnan(now) != np.isnan(before)).any():
        return math.inf
    now, before = np.nan_to_num(now), np.nan_to_num(before)
    if np.array_equal(now, before):
        return 0.0
    largest = max(abs(now).max(), abs(before).max())
    return float(abs(now - before).max() / largest)


def kind_of(command: str, path: str) -> str:
    """Return the command and the kind of a number, from its name."""
    if path.startswith("samples/"):
        kind = "samples"
    else:
        kind = next((k for k, end in KINDS.items() if re.search(end, path)), "other")
    return f"{command} {kind}{', later contacts' if LATER.search(path) else ''}"


def main() -> None:
    """Print the table; exit with 1 if a number differs, or only one checkout has it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("before", type=Path, help="folder of the other checkout")
    parser.add_argument("--all", action="store_true", help="print every name that differs")
    parser.add_argument("--only", default="", help="compare the commands that contain this text")
    options = parser.parse_args()
    differences = defaultdict(list)
    alone = defaultdict(list)
    with TemporaryDirectory() as name, ThreadPoolExecutor(2) as pool:
        folders = [Path(name) / side for side in ("now", "before")]
        for folder in folders:
            shutil.copytree(SCENES, folder)
        roots = (ROOT, options.before.resolve())
        for words in (words for words in commands() if options.only in " ".join(words)):
            now, before = pool.map(values_of, roots, [words, words], folders)
            for path in now.keys() & before.keys():
                worst = difference(now[path], before[path])
                at = f"{' '.join(words[1:])}: {path}"
                differences[kind_of(words[0], path)].append((worst, at))
                if worst and options.all:
                    print(f"{worst:.1e}  {words[0]} {at}")
            for path in now.keys() ^ before.keys():
                where = "now" if path in now else "before"
                general = re.sub(r"/\d+(?=/|$)", "/N", path)
                alone[f"only {where}: {words[0]} {general}"].append(words[1])
            print(" ".join(words), len(now), "numbers", flush=True)
    print(f"\n{'kind':40}{'numbers':>9}{'equal':>9}  largest relative difference")
    for kind, found in sorted(differences.items()):
        worst, at = max(found)
        equal = sum(1 for size, _ in found if size == 0.0)
        print(f"{kind:40}{len(found):9}{equal:9}  {worst:.1e}{f' at {at}' if worst else ''}")
    for name, places in sorted(alone.items()):
        print(f"{name} ({len(places)} times, first in {places[0]})")
    sys.exit(bool(alone) or any(max(found)[0] > 0.0 for found in differences.values()))


if __name__ == "__main__":
    main()
