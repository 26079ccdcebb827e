"""Studies and fits for scripts: modes, sweeps, tuning, budgets, margins, records and fits."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hertzloop.api.parameters import with_parameter_names
from hertzloop.api.runs import labelled_arrays
from hertzloop.api.scenes import AnyScene, resolved
from hertzloop.common.optional_dependencies import need
from hertzloop.loop.run_options import check_list
from hertzloop.scene.setup import Setup

if TYPE_CHECKING:
    import xarray as xr

    from hertzloop.fitting.fit.results import FitResult
    from hertzloop.fitting.records.record import Record
    from hertzloop.studies.budget.request import BudgetRequest
    from hertzloop.studies.budget.result import BudgetResult
    from hertzloop.studies.cases.axis import Range
    from hertzloop.studies.margin.margin import MarginResult
    from hertzloop.studies.margin.system import LinearSystem
    from hertzloop.studies.sweep.request import SweepRequest
    from hertzloop.studies.tune.request import TuneRequest
    from hertzloop.studies.tune.result import TuneResult


@with_parameter_names
def modes(scene: AnyScene) -> "xr.Dataset":
    """Return the modes of the plate model of a scene. Needs the extra `python`.

    Args:
        scene: the scene, or its name or TOML file.

    Returns:
        Dataset over `mode`, each variable of shape (modes,): `frequency_hz`, `loss_factor`,
        `modal_mass_kg`, `shape_contact`, `shape_actuator`. The attribute
        `residual_flexibility_m_n` (m/N) stands for the truncated modes.

    Raises:
        SceneError: the scene has no modes or cannot be simulated.
    """
    from hertzloop.results.scene_modes import modes_of_scene

    return labelled_arrays().modes_of(modes_of_scene(resolved(scene)))


@with_parameter_names
def sweep(
    scene: AnyScene, request: "SweepRequest | Mapping[str, Range]", **options: Any
) -> "xr.Dataset":
    """Compute the metrics of a scene over ranges of its keys. Needs the extra `python`.

    Args:
        scene: the scene, or its name or TOML file.
        request: which cases to run. A mapping stands for `SweepRequest(over=mapping)`.
        options: other fields of the request, for example `workers=1`.

    Returns:
        Dataset over `case`, each variable of shape (cases,): the metrics of `CaseMetrics`, nan
        where `state` and `status` say why, and `growth_per_s` of the linear loop: 0 if it is
        stable, nan without one. The varied keys are coordinates.

    Raises:
        DesignError: the ranges cannot be used.
        OptionError: text is given in place of a list.
        SceneError: the scene cannot be simulated.
        WorkersLost: a worker process was lost.
    """
    from hertzloop.studies.sweep.plan import plan_sweep
    from hertzloop.studies.sweep.request import SweepRequest
    from hertzloop.studies.sweep.sweep import sweep as run_sweep

    views = labelled_arrays()  # before the work, since a package may be missing
    if not isinstance(request, SweepRequest):
        request = SweepRequest(over=request)
    request = request.replaced(**options)
    plan = plan_sweep(resolved(scene), request)
    result = run_sweep(plan)
    header = {"scene": plan.setup.scene.name, "span": request.span}
    return views.cases_of(result.rows, plan.design.keys, header)


@with_parameter_names
def tune(
    scene: AnyScene | Sequence[AnyScene], request: "TuneRequest | None" = None, **options: Any
) -> "TuneResult":
    """Search the Pareto-optimal settings of laws (NSGA-II, Deb et al. 2002).

    Args:
        scene: the scene, or its name or TOML file; or several, of which the worst counts.
        request: what to search; None: the law of the scene over its usual ranges.
        options: other fields of the request, for example `laws=["predicted"]`.

    Returns:
        The settings that no other setting beats, and the published setting.

    Raises:
        DesignError: a range or a metric cannot be used.
        OptionError: text is given in place of a list.
        SceneError: a scene cannot be simulated.
        WorkersLost: a worker process was lost.
    """
    need("pymoo")
    from hertzloop.studies.tune.plan import plan_tune
    from hertzloop.studies.tune.request import TuneRequest
    from hertzloop.studies.tune.tune import tune as search_settings

    scenes = [scene] if isinstance(scene, AnyScene) else scene
    request = (request or TuneRequest()).replaced(**options)
    return search_settings(plan_tune([resolved(one) for one in scenes], request))


@with_parameter_names
def budget(
    scene: AnyScene, request: "BudgetRequest | None" = None, **options: Any
) -> "BudgetResult":
    """Find what a law tolerates: latency, bits and five more quantities.

    Args:
        scene: the scene with its law, or its name or TOML file.
        request: what to search; None: all limits of the default goal.
        options: other fields of the request, for example `quick=True`.

    Returns:
        Effect and limits in the scene and in the real plant.

    Raises:
        SceneError: the scene cannot be simulated, has no law, or a goal cannot be used.
        OptionError: text is given in place of a list.
        WorkersLost: a worker process was lost.
    """
    from hertzloop.studies.budget.budget import budget as search_budget
    from hertzloop.studies.budget.plan import plan_budget
    from hertzloop.studies.budget.request import BudgetRequest

    request = (request or BudgetRequest()).replaced(**options)
    return search_budget(plan_budget(resolved(scene), request))


@with_parameter_names
def margin(scene: AnyScene) -> "MarginResult":
    """Tell how stable the loop of a scene is, by linear theory.

    Args:
        scene: the scene with its law, or its name or TOML file.

    Returns:
        The margin in flight, the jitter margin, and the mode that limits the loop.

    Raises:
        SceneError: the scene cannot be simulated.
    """
    from hertzloop.studies.margin.margin import margin as analyse

    return analyse(resolved(scene))


@with_parameter_names
def linear(scene: AnyScene | Setup, quantity: str | None = None) -> "LinearSystem":
    """Return the sampled response of the plant in flight to the force of the actuator.

    Args:
        scene: the scene, or its name, TOML file or setup.
        quantity: "v_p" (m/s), "acceleration" (m/s^2) or "xi" (m); that of the scene by default.

    Returns:
        Poles, residues and finite impulse response.

    Raises:
        SceneError: the scheme or the quantity has no such response.
    """
    from hertzloop.studies.margin.system import LinearSystem

    return LinearSystem.of(scene if isinstance(scene, Setup) else resolved(scene), quantity)


@with_parameter_names
def read_record(path: str | Path, **table: Any) -> "Record":
    """Read a measured record.

    Args:
        path: a text table, a Parquet or NPZ file, or a recording of hertzloop.
        table: keys of the `[record]` table, which replace those of the file.

    Returns:
        The record, in SI units.

    Raises:
        RecordError: the file cannot be read, or the record cannot be used.
    """
    from hertzloop.fitting.records.reading import read_record

    return read_record(Path(path), table)


@with_parameter_names
def read_records(path: str | Path, **table: Any) -> "list[Record]":
    """Read the measured records of a file: one for each `[[record]]` table beside it, or one.

    Args:
        path: a file of `read_record`.
        table: as for `read_record`.

    Returns:
        The records, in SI units.

    Raises:
        RecordError: a file cannot be read, or a record cannot be used.
    """
    from hertzloop.fitting.records import reading

    return reading.read_records(Path(path), table)


@with_parameter_names
def fit(
    scene: AnyScene,
    records: "Record | str | Path | Sequence[Record | str | Path]",
    free: Sequence[str],
    *,
    hold_out: "Sequence[Record]" = (),
    exact: bool = False,
) -> "FitResult":
    """Fit keys of a scene to measured records of drops, with the law off or on.

    Args:
        scene: the scene, or its name or TOML file, with start values.
        records: one or several, as a `Record` or the path of its file.
        free: the keys to fit, `"KEY"`, `"KEY=LOW:HIGH"` or `"KEY±PRIOR"`.
        hold_out: records to compare with the fitted scene only.
        exact: whether to take the model as exact.

    Returns:
        Estimates with 95 % intervals and verdicts; `setup.scene` is the fitted scene.

    Raises:
        RecordError: a record cannot be used.
        FitError: a key cannot be fitted.
        OptionError: `free` is a text, not a list.
        SceneError: the scene cannot be simulated.
    """
    from hertzloop.fitting.fit.fit import fit as fit_records
    from hertzloop.fitting.fit.free_keys import parse_free_key
    from hertzloop.fitting.records.record import Record

    check_list("free", free)
    setup = resolved(scene)
    given = [records] if isinstance(records, Record | str | Path) else list(records)
    several = [
        found
        for one in given
        for found in ([one] if isinstance(one, Record) else read_records(one))
    ]
    keys = [parse_free_key(setup, text) for text in free]
    return fit_records(setup, several, keys, hold_out, exact=exact)
