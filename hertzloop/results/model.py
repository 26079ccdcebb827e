"""The models that a run used for its plant, and what they cost against the full model."""

import math
import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from hertzloop.bus.messages_pb2 import EnergyBalance
from hertzloop.plant.plant import Balance, PlantSpec
from hertzloop.plant.schemes.factory import built
from hertzloop.plant.schemes.infinite import impedance_n_s_m
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.plant.state_kernels import FLIGHT_X, XI, XI_S
from hertzloop.plant.structures.structure import frequencies
from hertzloop.plant.time_series import series_under
from hertzloop.scene.plate_model import NEAREST, wavelengths_to_edge
from hertzloop.scene.setup import Setup

_COUNTED = 500_000  # modes; beyond, the full model is only said to be larger
_TIMED = 4_000  # frequencies that can be built and timed within 0.3 s
_LIFT_M = 1e3  # keeps the sphere off the plate
_ROUNDS, _STEPS = 5, 1_000  # of the timing, both models in turn


@dataclass(frozen=True)
class FullModel:
    """The cost of all modes that the step supports.

    Attributes:
        frequency_limit_hz: limit of these modes, Hz.
        modes: their approximate number.
        frequencies: number of their frequencies; None if too many to count.
        frequency_ratio: that number over the chosen one; None for an infinite plate.
        measured_ratio: measured time of a step under force over that of the chosen model; None if
            the measurement would take long.
    """

    frequency_limit_hz: float
    modes: float
    frequencies: int | None = None
    frequency_ratio: float | None = None
    measured_ratio: float | None = None


@dataclass(frozen=True)
class PlateModel:
    """The model of a plate.

    Attributes:
        plate_model: "modal" or "infinite".
        impedance_n_s_m: impedance of the infinite plate, N s/m; None for another structure.
        infinite_until_s: time until which the infinite plate is accurate enough, s; None if it is
            not for a whole contact.
        full: the cost of all modes.
    """

    plate_model: str
    impedance_n_s_m: float | None
    infinite_until_s: float | None
    full: FullModel


@dataclass(frozen=True)
class TruncatedModes:
    """The damped mode that replaces the truncated modes.

    Attributes:
        lost_j: energy that it dissipated, J.
        wavelengths_to_edge: distance of the contact point from an edge, wavelengths at the limit.
        needed: distance from which on the damped mode is accurate.
    """

    lost_j: float
    wavelengths_to_edge: float
    needed: float


@dataclass(frozen=True)
class Yield:
    """Permanent indentation, m, and dissipated energy, J, of a contact that yielded."""

    dent_m: float
    dissipated_j: float


@dataclass(frozen=True)
class PlantParts:
    """The models that a run used for its plant.

    Attributes:
        truncated_modes: the damped mode for the truncated modes; None if there is none.
        limiting_pressure: as in the function `limiting_pressure`.
        model: the model of the plate; None for the published scheme.
    """

    truncated_modes: TruncatedModes | None
    limiting_pressure: dict[str, Any] | None
    model: PlateModel | None


def chosen_model(setup: Setup) -> PlateModel | None:
    """Return the plate model of a run and the cost of the full model; None for the published
    scheme, which always has the full model."""
    if not SCHEMES[setup.scheme].limits_modes:
        return None
    spec = setup.plant
    lasts_s, local = setup.infinite_plate.lasts_s(), spec.plate.local_plate
    return PlateModel(
        plate_model="infinite" if spec.infinite_plate else "modal",
        impedance_n_s_m=impedance_n_s_m(local) if local else None,
        infinite_until_s=setup.first_touch_s + lasts_s if lasts_s else None,
        full=_full_model(setup, spec),
    )


def _full_model(setup: Setup, spec: PlantSpec) -> FullModel:
    limit_hz = 0.5 / setup.step_s
    if spec.plate.mode_table is None:
        limit_hz = min(limit_hz, spec.plate.highest_hz)
    modes = spec.plate.modes_below(limit_hz)
    if modes > _COUNTED:
        return FullModel(limit_hz, modes)

    def count(up_to_hz: float) -> int:
        omega = 2.0 * math.pi * up_to_hz
        return frequencies(spec.plate, spec.contact_point_m, spec.actuator_point_m, omega)

    found, ratio, measured = count(limit_hz), None, None
    if not spec.infinite_plate:
        ratio = found / count(spec.frequency_limit_hz)
    if found <= _TIMED:
        whole = replace(spec, frequency_limit_hz=limit_hz, infinite_plate=False)
        chosen = built(spec, setup.scheme)
        # Time of a step under an actuator force, the one's against the other's: least of some
        # rounds in which they take turns. (In flight a damped plate's modes fall silent and cost
        # nothing.)
        plants = [built(whole, setup.scheme).at_start(), chosen.at_start()]
        for plant in plants:
            plant.state.body[[FLIGHT_X, XI, XI_S]] += _LIFT_M
        least, force = [math.inf, math.inf], np.ones(_STEPS)
        for _ in range(_ROUNDS):
            for i, plant in enumerate(plants):
                started = time.perf_counter()
                series_under(plant, force)
                least[i] = min(least[i], time.perf_counter() - started)
        measured = least[0] / least[1]
    return FullModel(limit_hz, modes, found, ratio, measured)


def yield_of(balance: EnergyBalance | Balance | None) -> Yield | None:
    """Return the indentation; None if the contact did not yield or the run did not end."""
    if balance is None or balance.dent_m == 0.0:
        return None
    return Yield(balance.dent_m, balance.plastic_dissipated_j)


def limiting_pressure(setup: Setup) -> dict[str, Any] | None:
    """Return the pressure at which a contact yields; None for a contact that does not yield.

    Returns:
        `pressure_pa`; `given`, whether the scene states it; and `by`, otherwise the `body` that
        yields with the fields of `YieldPressure`.
    """
    limit = setup.contact.limit
    if limit is None:
        return None
    given = setup.scene.contact.limiting_pressure_pa is not None
    found = setup.mechanics.weaker
    by = None if given or found is None else {"body": found[0], **asdict(found[1])}
    return {"pressure_pa": limit.pressure_pa, "given": given, "by": by}


def parts_of(setup: Setup, balance: EnergyBalance) -> PlantParts:
    """Return the models that a completed run used for its plant."""
    away = None
    if setup.plant.damped_residual:
        away = wavelengths_to_edge(setup.mechanics, setup.plant.frequency_limit_hz)
    return PlantParts(
        truncated_modes=None
        if away is None
        else TruncatedModes(balance.truncated_dissipated_j, away, NEAREST),
        limiting_pressure=limiting_pressure(setup),
        model=chosen_model(setup),
    )


def structure_summary(setup: Setup) -> dict[str, Any]:
    """Return `name` and `closed_form` of the structure, and the quality of its modes as in
    `RitzAccuracy` and `ModalStructure.mobility_ratio`."""
    what = setup.structure
    if what.quality is None:
        plain = what.simply_supported is not None
        return {"name": "a simply supported plate" if plain else str(what), "closed_form": True}
    modes = setup.scene.plate.modes
    of_file = {} if what.mode_table is None else {"sha256": modes.sha256 if modes else ""}
    return {"name": str(what), "closed_form": False, **what.quality, **of_file}
