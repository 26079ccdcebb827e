"""Streams of a run as labelled arrays with units, for notebooks and scripts."""

from collections.abc import Mapping
from itertools import zip_longest
from typing import Any

import numpy as np
import xarray as xr

from hertzloop.plant.structures.mode_file import ModeTable
from hertzloop.plant.time_series import TRUTH
from hertzloop.views.labels import HELD


def labelled(values: np.ndarray, label: tuple[str, str], dim: str, time_s: np.ndarray) -> Any:
    """Return a stream as a DataArray, without a copy.

    Args:
        values: The samples.
        label: Unit and meaning.
        dim: Name of the dimension.
        time_s: Time of each sample, s; it becomes a coordinate.
    """
    units, meaning = label
    coords = {"time_s": (dim, time_s, {"units": "s", "long_name": "simulated time"})}
    attrs = {"units": units, "long_name": meaning}
    return xr.DataArray(values, dims=(dim,), coords=coords, attrs=attrs)


def truth_of(columns: Mapping[str, np.ndarray], step_s: float) -> xr.Dataset:
    """Return the ground truth as a Dataset over `step`; names of columns as in TRUTH and HELD."""
    labels = TRUTH | HELD
    steps = max((len(values) for values in columns.values()), default=0)
    time_s = np.arange(steps) * step_s
    return xr.Dataset(
        {name: labelled(values, labels[name], "step", time_s) for name, values in columns.items()}
    )


def cases_of(rows: list[dict[str, Any]], keys: list[str], header: Mapping[str, Any]) -> xr.Dataset:
    """Return the results of a sweep as a Dataset over `case`; varied scene keys are coordinates.

    A metric that a case does not have is nan; `state` names the reason and `status` explains it.
    Units are in the names, as in the file of the sweep. Lists among the metrics become rows over
    `sample`, with nan after their end; a coordinate keeps each list as one object.
    """
    names = [name for name in rows[0] if name not in ("case", *keys)] if rows else []
    data = {name: _variable([row[name] for row in rows]) for name in names}
    coords = {key: ("case", _coordinate([row[key] for row in rows])) for key in keys}
    return xr.Dataset(data, coords, attrs=dict(header))


def _coordinate(values: list[Any]) -> Any:
    """Return the values of a scene key, one for each case."""
    if not any(isinstance(value, list | tuple) for value in values):
        return values
    objects = np.empty(len(values), dtype=object)
    objects[:] = [tuple(value) if isinstance(value, list) else value for value in values]
    return objects


def _variable(values: list[Any]) -> tuple[Any, Any]:
    """Return the dimensions and the values of a variable of `cases_of`."""
    if not any(isinstance(value, list) for value in values):
        return "case", [np.nan if value is None else value for value in values]
    by_sample = zip_longest(*(value or () for value in values), fillvalue=np.nan)
    return ("case", "sample"), np.array(list(by_sample)).T


def modes_of(table: ModeTable) -> xr.Dataset:
    """Return modes as a Dataset over `mode`, with the columns of a file of modes."""
    columns = {
        "frequency_hz": (table.omega_rad_s / (2.0 * np.pi), "Hz", "frequency"),
        "loss_factor": (table.loss_factor, "1", "loss factor"),
        "modal_mass_kg": (1.0 / table.per_modal_mass_1_kg, "kg", "modal mass"),
        "shape_contact": (table.shape_contact, "1", "shape at the contact point"),
        "shape_actuator": (table.shape_actuator, "1", "shape at the actuator"),
    }
    return xr.Dataset(
        {
            name: ("mode", values, {"units": units, "long_name": meaning})
            for name, (values, units, meaning) in columns.items()
        },
        attrs={"residual_flexibility_m_n": table.residual_flexibility_m_n},
    )
