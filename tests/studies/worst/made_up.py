"""Cases of a search: simulated in this process, or made up."""

from typing import Any

import numpy as np

from hertzloop.scene.setup import Setup
from hertzloop.studies.cases.evaluate import run_cases

SCENE = ["run.duration_s=0.0016"]


def simulated(setup: Setup, cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rows of cases, in their order."""
    rows = run_cases(setup, "impact", list(enumerate(cases)))
    return sorted(rows, key=lambda row: int(row["case"]))


def made_up(weights: np.ndarray) -> Any:
    """Rows of cases whose plate energy is a weighted sum of the last latencies."""

    def run(cases: list[dict[str, Any]]) -> list[dict[str, Any]]:
        rows = []
        for case in cases:
            last = np.array(case.get("controller.latency_trace", [0.0]))[-len(weights) :]
            energy = float(np.sum(weights[-len(last) :] * last))
            why = {"status": "", "state": "metrics"}
            rows.append({"plate_energy_db": energy, "steps": 1030, "contact_us": 30, **why})
        return rows

    return run
