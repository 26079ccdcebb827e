"""The models that a run used for its plant."""

from dataclasses import asdict, dataclass
from typing import Any

from hertzloop.bus.messages_pb2 import EnergyBalance
from hertzloop.plant.plant import Balance
from hertzloop.plant.schemes.modal import impedance_n_s_m
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.scene.plate_model import NEAREST, wavelengths_to_edge
from hertzloop.scene.setup import Setup


@dataclass(frozen=True)
class PlateModel:
    """The model of a plate.

    Attributes:
        plate_model: "modal" or "infinite".
        impedance_n_s_m: impedance of the infinite plate, N s/m; None for another structure.
    """

    plate_model: str
    impedance_n_s_m: float | None


@dataclass(frozen=True)
class TruncatedModes:
    """The damped mode that replaces the truncated modes.

    Attributes:
        wavelengths_to_edge: distance of the contact point from an edge, wavelengths at the limit.
        needed: distance from which on the damped mode is accurate.
    """

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
    """Return the plate model of a run; None for the published scheme, which has all modes."""
    if not SCHEMES[setup.run.scheme].limits_modes:
        return None
    local = setup.plant.plate.local_plate
    return PlateModel(
        plate_model="infinite" if setup.plant.infinite_plate else "modal",
        impedance_n_s_m=impedance_n_s_m(local) if local else None,
    )


def step_limit_hz(setup: Setup) -> float:
    """Return the limit of the modes that the step supports and the structure knows, Hz."""
    plate, limit_hz = setup.plant.plate, 0.5 / setup.run.step_s
    return limit_hz if plate.mode_table is not None else min(limit_hz, plate.highest_hz)


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
    limit = setup.mechanics.contact.limit
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
        truncated_modes=None if away is None else TruncatedModes(away, NEAREST),
        limiting_pressure=limiting_pressure(setup),
        model=chosen_model(setup),
    )


def structure_summary(setup: Setup) -> dict[str, Any]:
    """Return `name` and `closed_form` of the structure, and the quality of its modes as in
    `RitzAccuracy` and `ModalStructure.mobility_ratio`."""
    what = setup.mechanics.structure
    if what.quality is None:
        plain = what.simply_supported is not None
        return {"name": "a simply supported plate" if plain else str(what), "closed_form": True}
    modes = setup.scene.plate.modes
    of_file = {} if what.mode_table is None else {"sha256": modes.sha256 if modes else ""}
    return {"name": str(what), "closed_form": False, **what.quality, **of_file}
