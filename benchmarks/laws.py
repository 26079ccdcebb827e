"""What a law of one's own costs against the same law as it is shipped: per case, and at the start.

`slope_threshold` as shipped, as a file of one's own and as a C library: same bytes, and the
cases of a sweep and of a search in turns, so that whatever else the machine does hits all alike.
"""

import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
    RoundsOption,
    bars,
    check_json,
    compile_first,
    conclude,
    number_table,
    out,
    results_in,
    start,
    tracked,
    write_json,
    written,
)
from hertzloop.controller.loading.registry import SHIPPED
from hertzloop.results.cases import metrics_of_case
from hertzloop.scene.setup import Setup, load
from hertzloop.studies.requests import TuneRequest
from hertzloop.studies.sweeps.design import Axis
from hertzloop.studies.sweeps.evaluate import Pool, evaluate
from hertzloop.studies.sweeps.pool import local_pool
from hertzloop.studies.tuning import tune
from hertzloop.studies.words import write_rows

LAW = "slope_threshold"
# A law in C does not say how far its force reaches, so the plate has its modes for all of them.
_SCENE = ("run.duration_s=0.0016", "run.plate_model=modal")
_KEYS = ("controller.kappa=0.8", "controller.v_thr_m_s=-0.25")
_CASES = [{"controller.latency_us": float(us), "controller.kappa": 0.05 * k}
          for us in range(8) for k in range(8)]  # fmt: skip
_AXES = (Axis("controller.kappa", (), 0.0, 1.0), Axis("controller.v_thr_m_s", (), -0.9, 0.0))
_FIRST_STEP = (
    "from hertzloop.loop.simulate import simulate; from hertzloop.scene.setup import load; "
    "simulate(load('{scene}', ['run.duration_s=2e-6', 'controller.law={law}']), {whole})"
)


@contextmanager
def own_laws() -> Iterator[dict[str, str]]:
    """References of the law by how it is given; "C library" only where there is a compiler."""
    with tempfile.TemporaryDirectory(prefix="hertzloop-") as name:
        folder = Path(name)
        laws = {"shipped": LAW, "Python file": str(_copied(folder / "mine.py"))}
        if shutil.which("cc"):
            laws["C library"] = str(_built(folder))
        yield laws


def _copied(path: Path, more: str = "") -> Path:
    path.write_text((SHIPPED / f"{LAW}.py").read_text(encoding="utf-8") + more, encoding="utf-8")
    return path


def _built(folder: Path) -> Path:
    """The law in C as a library in `folder`."""
    header = resources.files("hertzloop.controller") / "loading" / "start" / "hertzloop_law.h"
    (folder / "hertzloop_law.h").write_text(header.read_text("utf-8"), encoding="utf-8")
    library, source = folder / "mine.so", folder / "mine.c"
    source.write_text(Path(__file__).with_name(f"{LAW}.c").read_text("utf-8"), encoding="utf-8")
    words = ["cc", "-O2", "-fPIC", "-shared", "-ffp-contract=off", str(source), "-o", str(library)]
    subprocess.run([*words, "-lm"], check=True)
    return library


def _setup(law: str) -> Setup:
    return load("aluminium-3mm", [*_SCENE, f"controller.law={law}", *_KEYS])


def same_bytes(laws: dict[str, str]) -> bool:
    """Whether all samples and rows of truth are the same, however the law is given."""
    return len({metrics_of_case(_setup(law)).digest for law in laws.values()}) == 1


def _swept(pool: Pool, law: str) -> int:
    """Run the cases of a sweep; their number."""
    rows = evaluate(pool, _setup(law), "impact", _CASES)
    if any(row["status"] for row in rows):
        raise RuntimeError(f"a case of {law} failed: {rows[0]['status']}")
    return len(rows)


def _tuned(pool: Pool, law: str) -> int:
    """Search for the law's best setting; how many cases that took."""
    generations, population = 4, 16
    tune(
        pool, [_setup(law)], law, _AXES,
        TuneRequest(("plate_energy_db",), generations=generations, population=population),
    )  # fmt: skip
    return generations * population


def rates(laws: dict[str, str], rounds: int) -> list[dict[str, Any]]:
    """Cases per second of processor time of one core, and the share of the shipped law's in the
    same round; medians of `rounds`."""
    found = []
    tasks: dict[str, Callable[[Pool, str], int]] = {"sweep": _swept, "tune": _tuned}
    with local_pool(1) as pool:
        for task, run in tasks.items():
            taken: dict[str, list[float]] = {name: [] for name in laws}
            for turn in tracked(task, range(rounds + 1)):
                for name, law in laws.items():
                    started = time.process_time()
                    cases = run(pool, law)
                    if turn:  # the first loads what is compiled
                        taken[name].append(cases / (time.process_time() - started))
            for name, rate in taken.items():
                shares = [a / b for a, b in zip(rate, taken["shipped"], strict=True)]
                found.append({
                    "task": task, "law": name, "cases_per_s": statistics.median(rate),
                    "share": statistics.median(shares),
                })  # fmt: skip
    return found


def _to_first_step_s(law: str, whole: bool = False) -> float:
    """Seconds of a process; `whole`: with what the law knows ahead, as sweeps ask."""
    started = time.perf_counter()
    script = _FIRST_STEP.format(scene="aluminium-3mm", law=law, whole=whole)
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True)
    return time.perf_counter() - started


def starts(rounds: int) -> dict[str, float]:
    """Seconds from the start of a process to the first step with the shipped law, and how much more
    it takes with a law that this machine has never seen: its command alone, or all four functions,
    as sweeps and controllers on the bus need them; medians of `rounds` in turns."""
    shipped, more, whole = [], [], []
    with tempfile.TemporaryDirectory(prefix="hertzloop-") as folder:
        for turn in tracked("starts", range(rounds + 1)):
            new = [str(_copied(Path(folder) / f"new{turn}{i}.py", f"\n# {time.time_ns()}\n"))
                   for i in range(2)]  # fmt: skip
            known = _to_first_step_s(LAW)
            first, all_ = _to_first_step_s(new[0]), _to_first_step_s(new[1], whole=True)
            if turn:
                shipped.append(known)
                more.append(first - known)
                whole.append(all_ - known)
    return {
        "shipped_s": statistics.median(shipped), "new_law_more_s": statistics.median(more),
        "new_law_whole_more_s": statistics.median(whole),
    }  # fmt: skip


def main(
    folder: OutDirOption = None,
    rounds: RoundsOption = 7,
    quick: QuickOption = False,
    json_file: JsonOption = None,
) -> None:
    """Measure what a law of your own costs, in Python and in C, against the same law as shipped.

    Example: python -m benchmarks.laws --quick
    """
    check_json(json_file)
    rounds = 1 if quick else rounds
    with results_in(folder, "laws") as made:
        compile_first()
        with own_laws() as laws:
            same = same_bytes(laws)
            found = rates(laws, rounds)
        begun = starts(rounds)
        write_rows(made / "laws.csv", list(found[0]), (list(row.values()) for row in found))
        write_rows(made / "laws-starts.csv", ["start", "seconds"], begun.items())
        sizes = [(f"{row['task']}, {row['law']}", float(row["share"])) for row in found]
        bars(made / "laws.png", f"{LAW} in cases of one core", "cases/s over shipped", sizes)
    headings = ("task", "law", "cases/s", "of shipped")
    rows = [
        (row["task"], row["law"], f"{row['cases_per_s']:.0f}", f"{row['share']:.2f}")
        for row in found
    ]
    out.print(number_table(f"{LAW} in cases of one core", headings, rows, text=2))
    out.print(f"same bytes however it is given: {'yes' if same else 'NO'}")
    out.print(
        f"to the first step: {begun['shipped_s']:.2f} s with the shipped law, "
        f"{begun['new_law_more_s']:+.2f} s with a new one in Python, "
        f"{begun['new_law_whole_more_s']:+.2f} s where what it knows ahead is asked for, too",
        soft_wrap=True,
    )
    written(made, "laws.csv", "laws-starts.csv", "laws.png")
    own = [row for row in found if row["law"] != "shipped"]
    slowest = min(own, key=lambda row: row["share"])
    conclude(
        f"A law of your own runs at least {slowest['share']:.2f} times as many cases in a second "
        f"as the shipped one ({slowest['law']}, {slowest['task']}), and its bytes are "
        f"{'equal' if same else 'NOT equal'}."
    )
    write_json(json_file, {"same_bytes": same, "rates": found, **begun})


if __name__ == "__main__":
    start("benchmarks.laws")
