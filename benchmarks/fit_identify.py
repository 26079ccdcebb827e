"""Questions that a record can answer, and questions that it cannot.

Each is a scene, a synthetic record with 0.3 % noise, and free keys.
"""

from dataclasses import asdict, dataclass

from benchmarks.program import (
    JsonOption,
    OutDirOption,
    QuickOption,
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
    write_records,
    written,
)
from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.identification.fit.fit import fit
from hertzloop.identification.fit.free_keys import parse_free_key
from hertzloop.scene.setup import load

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


@dataclass(frozen=True)
class Answer:
    """What `fit` said to a question: `identifiable` is true of it, `answer` what was said.

    `worst`: the combination of keys that the record tells least about.
    """

    quantity: str
    duration_s: float
    keys: str
    identifiable: bool
    answer: bool
    model: str
    worst: str
    verdicts: str


def ask(question: tuple[tuple[str, ...], str, float, tuple[str, ...], bool]) -> Answer:
    """Put a question to a synthetic record."""
    changes, quantity, duration_s, keys, told = question
    setup = load("aluminium-3mm", ["controller.law=off", *changes])
    record = measured(truth(setup, quantity, duration_s, accuracy=1e-4), Spoilt(), 3)
    found = fit(setup, [record], [parse_free_key(setup, key) for key in keys])
    return Answer(
        quantity, duration_s, " ".join(keys), told, found.identifiable, str(found.model),
        str(found.combinations[0]) if found.combinations else keys[0],
        ", ".join(f"{e.key}: {e.verdict}" for e in found.estimates),
    )  # fmt: skip


def main(
    folder: OutDirOption = None, quick: QuickOption = False, json_file: JsonOption = None
) -> None:
    """Ask `hertzloop fit` ten questions that a record can answer, and ten that it cannot.

    Each is a synthetic record with 0.3 % noise and free keys. Ten are unidentifiable, by an exact
    symmetry or because the record is too short. With --quick there are two of each.

    Example: python -m benchmarks.fit_identify --quick
    """
    check_json(json_file)
    with results_in(folder, "fit_identify") as made:
        compile_first()
        asked = (*QUESTIONS[:2], *QUESTIONS[-2:]) if quick else QUESTIONS
        found = [ask(question) for question in tracked("questions", asked)]
        write_records(made / "fit_identify.csv", found)
        counts = [
            (f"{kind}, {said}",
             float(sum(a.answer == said_so for a in found if a.identifiable == true)))
            for kind, true in (("identifiable", True), ("not identifiable", False))
            for said, said_so in (("accepted", True), ("refused", False))
        ]  # fmt: skip
        bars(made / "fit_identify.png", "Questions to a record", "questions", counts)
    headings = ("quantity", "s", "keys", "can be told", "answer", "worst combination")
    rows = [(a.quantity, f"{a.duration_s:g}", a.keys, _YES_NO[a.identifiable],
             "accepted" if a.answer else "refused", a.worst) for a in found]  # fmt: skip
    out.print(number_table("questions", headings, rows, text=6))
    written(made, "fit_identify.csv", "fit_identify.png")
    right = sum(a.identifiable == a.answer for a in found)
    conclude(f"The check of identifiability answers {right} of {len(found)} questions right.")
    write_json(json_file, {"questions": [asdict(a) for a in found]})


_YES_NO = {True: "yes", False: "no"}


if __name__ == "__main__":
    start("benchmarks.fit_identify")
