"""The models that a run used for its plant, as plain data for `--json` and the table of details."""

from dataclasses import asdict, dataclass
from typing import Any

from hertzloop.bus.messages_pb2 import EnergyBalance
from hertzloop.plant.plant import Balance
from hertzloop.plant.schemes.modal import impedance_n_s_m
from hertzloop.plant.schemes.registry import SCHEMES
from hertzloop.scene.plate_model import NEAREST, wavelengths_to_edge
from hertzloop.scene.setup import Setup


@dataclass(frozen=True)
class Yield:
    """Permanent indentation, m, and dissipated energy, J, of a contact that yielded."""

    dent_m: float
    dissipated_j: float


def yield_of(balance: EnergyBalance | Balance | None) -> Yield | None:
    """Return the indentation; None if the contact did not yield or the run did not end."""
    if balance is None or balance.dent_m == 0.0:
        return None
    return Yield(balance.dent_m, balance.plastic_dissipated_j)


def plate_model(setup: Setup) -> dict[str, Any] | None:
    """Return the plate model, and the impedance of the infinite plate, N s/m; None for the
    published scheme, which has all modes."""
    if not SCHEMES[setup.run.scheme].limits_modes:
        return None
    local = setup.plant.plate.local_plate
    return {
        "plate_model": "infinite" if setup.plant.infinite_plate else "modal",
        "impedance_n_s_m": impedance_n_s_m(local) if local else None,
    }


def truncated_modes(setup: Setup) -> dict[str, Any] | None:
    """Return how far the contact is from an edge, and how far it has to be for the damped mode that
    replaces the truncated modes, both in wavelengths at the limit; None without that mode."""
    spec = setup.plant
    if not spec.damped_residual:
        return None
    away = wavelengths_to_edge(setup.mechanics, spec.frequency_limit_hz)
    return {"wavelengths_to_edge": away, "needed": NEAREST}


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


def structure_summary(setup: Setup) -> dict[str, Any]:
    """Return `name` and `closed_form` of the structure, and the quality of its modes as in
    `EdgedPlate.quality` and `ModalStructure.quality`."""
    what = setup.mechanics.structure
    if what.quality is None:
        plain = what.simply_supported is not None
        return {"name": "a simply supported plate" if plain else str(what), "closed_form": True}
    modes = getattr(setup.scene.plate, "modes", None)
    of_file = {} if modes is None else {"sha256": modes.sha256}
    return {"name": str(what), "closed_form": False, **what.quality, **of_file}
