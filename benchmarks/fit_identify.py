"""Questions that a record can answer, and questions that it cannot.

`python -m benchmarks.fit_identify` asks them. Each is a scene, a synthetic record with 0.3 % noise,
and free keys. Ten are unidentifiable, by an exact symmetry or because the record is too short;
ten are not. The program prints the verdicts, and how many are right.
"""

import argparse
import json
from pathlib import Path

from hertzloop.setup import load
from hertzloop.studies.fit.fit import fit, free_of
from hertzloop.studies.fit.synthetic import Spoilt, measured, truth

_YIELDS = ("contact.plasticity=thornton", "contact.limiting_pressure_pa=8e8")
_FORCE, _V = "contact_force", "v_p"
_BALL, _PLATE = "sphere.material.young_pa", "plate.material.young_pa"
_R, _H, _RHO = "sphere.radius_m", "sphere.drop_height_m", "sphere.material.density_kg_m3"
_PLATE_RHO, _THICK, _LOSS = (
    "plate.material.density_kg_m3", "plate.thickness_m", "plate.loss_factor",
)  # fmt: skip
_FACTOR, _PRESSURE = "contact.stiffness_factor", "contact.limiting_pressure_pa"

# Changes, quantity, duration (s), keys; whether the record tells them.
QUESTIONS: tuple[tuple[tuple[str, ...], str, float, tuple[str, ...], bool], ...] = (
    (_YIELDS, _FORCE, 70e-6, (_PLATE_RHO, _THICK), False),
    (_YIELDS, _FORCE, 70e-6, (_LOSS,), False),
    (_YIELDS, _V, 150e-6, (_LOSS,), False),
    (_YIELDS, _FORCE, 70e-6, (_PLATE_RHO, _THICK, _PLATE), False),
    (_YIELDS, _FORCE, 70e-6, (_BALL, _FACTOR), False),
    (_YIELDS, _V, 1e-3, (_BALL, _FACTOR), False),
    ((), _V, 1e-3, (_R, _RHO, _FACTOR), False),
    ((), _FORCE, 70e-6, (_R, _RHO, _FACTOR), False),
    (_YIELDS, _V, 150e-6, (_R, _RHO, _PRESSURE), False),
    ((), _V, 150e-6, (_R, _RHO, _BALL), False),
    ((), _FORCE, 70e-6, (_R,), True),
    (_YIELDS, _FORCE, 70e-6, (_PRESSURE,), True),
    (_YIELDS, _FORCE, 70e-6, (_PRESSURE, _H), True),
    (_YIELDS, _FORCE, 90e-6, (_PRESSURE, _H, _FACTOR), True),
    (_YIELDS, _FORCE, 70e-6, (_PLATE,), True),
    (_YIELDS, _V, 1e-3, (_THICK, _R), True),
    (_YIELDS, _V, 1e-3, (_THICK, _PLATE_RHO), True),
    (_YIELDS, _V, 150e-6, (_THICK,), True),
    (("plate.loss_factor=1e-3",), _V, 3e-3, (_LOSS, _THICK), True),
    ((), _V, 1e-3, (_R, _FACTOR), True),
)


def main() -> None:
    """Ask all questions."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, help="file for the answers, JSON")
    given = parser.parse_args()
    answers, right = [], 0
    for changes, quantity, duration_s, keys, told in QUESTIONS:
        setup = load("aluminium-3mm", ["controller.law=off", *changes])
        record = measured(truth(setup, quantity, duration_s, accuracy=1e-4), Spoilt(), 3)
        found = fit(setup, [record], [free_of(setup, key) for key in keys])
        right += found.identifiable == told
        worst = str(found.combinations[0]) if found.combinations else keys[0]
        answers.append({
            "quantity": quantity, "duration_s": duration_s, "keys": keys, "identifiable": told,
            "answer": found.identifiable, "model": str(found.model), "worst": worst,
            "verdicts": {e.key: str(e.verdict) for e in found.estimates},
        })  # fmt: skip
        print(json.dumps(answers[-1]))
    print(f"{right} of {len(QUESTIONS)} answers are right")
    if given.out:
        given.out.write_text(json.dumps(answers, indent=1) + "\n")


if __name__ == "__main__":
    main()
