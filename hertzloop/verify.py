"""A-posteriori check of a run: its first impact again with half the step and twice the modes."""

from dataclasses import asdict, dataclass, replace

import numpy as np

from hertzloop import parts
from hertzloop.compiled import rows_under
from hertzloop.impact_rows import F_A, XI, consistent_impacts, impacts_of_rows
from hertzloop.scene import Scene, SceneError
from plant import kernels as pk

_START = [pk.FLIGHT_X, pk.FLIGHT_V, pk.XI, pk.XI_S]


@dataclass(frozen=True)
class Verification:
    """What the finer model changes in the first impact: gap relative to its largest value in
    contact, rebound speed to the impact speed, plate energy to itself; and what it was."""

    penetration: float
    rebound_speed: float
    plate_energy: float
    step_ns: float
    frequency_limit_hz: float

    @property
    def largest(self) -> float:
        """Largest of the three relative changes."""
        return max(self.penetration, self.rebound_speed, self.plate_energy)


def verify(scene: Scene, rows: np.ndarray) -> Verification | None:
    """Repeat the first impact of a run from its rows of truth, with the same actuator forces.

    The controller is not asked again: a loop with half the step would be another loop. None
    without an impact that ends within the run. Raises SceneError for the published scheme.
    """
    if scene.run.scheme == "thesis2008":
        raise SceneError(
            "run.scheme = 'thesis2008' does not converge, so there is nothing to verify; take "
            "'modal' or 'discrete_gradient'"
        )
    found = impacts_of_rows(scene, rows, most=1)
    if not found or not found[0].ended:
        return None
    first = found[0]
    spec = parts.plant_spec(scene)
    # Past the contact by one step, so that it is seen to end.
    until = min(first.end + 2, rows.shape[1])
    start = parts.plant_of(spec, scene).state.body[_START]
    fine = replace(
        spec,
        step_s=spec.step_s / 2,
        frequency_limit_hz=2.0 * spec.frequency_limit_hz,
        residual_flexibility=scene.run.scheme == "modal",
        infinite_plate=False,
    )
    plant = parts.plant_of(fine, scene)
    plant.state.body[_START] = start
    doubled = rows_under(plant, np.repeat(rows[F_A, :until], 2))
    gap, finer = rows[XI, :until], doubled[XI, ::2]
    coarse_impact = consistent_impacts(scene, rows[:, :until], spec)[0]
    # Work counts from row to row: without the last half step both end at the same time.
    fine_impact = consistent_impacts(scene, doubled[:, :-1], fine)[0]
    energy = fine_impact.plate_energy_j
    change = fine_impact.rebound_speed_m_s - coarse_impact.rebound_speed_m_s
    return Verification(
        penetration=float(np.abs(gap - finer).max() / -finer.min()),
        rebound_speed=abs(change) / coarse_impact.impact_speed_m_s,
        plate_energy=abs(coarse_impact.plate_energy_j - energy) / abs(energy),
        step_ns=scene.run.step_ns / 2,
        frequency_limit_hz=fine.frequency_limit_hz,
    )


def as_json(found: Verification | None) -> dict[str, float] | None:
    """For --json."""
    return None if found is None else {**asdict(found), "largest": found.largest}
