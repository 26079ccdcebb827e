"""Studies for scripts: modes, sweeps, tuning and the linear response."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from hertzloop.api.runs import labelled_arrays
from hertzloop.api.scenes import AnyScene, resolved
from hertzloop.common.optional_dependencies import need
from hertzloop.scene.setup import Setup

if TYPE_CHECKING:
    import xarray as xr

    from hertzloop.studies.margin.system import LinearSystem
    from hertzloop.studies.tuning import Candidate

Range = str | Sequence[Any]


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
    from hertzloop.results.deflection import modes_of_scene

    return labelled_arrays().modes_of(modes_of_scene(resolved(scene)))


def sweep(
    scene: AnyScene,
    over: Mapping[str, Range],
    *,
    design: Literal["grid", "lhs", "sobol"] = "grid",
    cases: int = 256,
    span: Literal["impact", "run"] = "impact",
    workers: int | None = None,
    worst: str | None = None,
) -> "xr.Dataset":
    """Compute the metrics of a scene over ranges of its keys. Needs the extra `python`.

    Args:
        scene: the scene, or its name or TOML file.
        over: by scene key a list of values, "low:high:step" (a grid) or "low:high" (to be spread).
        design: "grid" for all combinations; "lhs" or "sobol" for spread points.
        cases: number of spread points.
        span: "impact" for the first impact, "run" for all contacts.
        workers: number of processes; None for one per core.
        worst: name of a metric whose worst value over all latencies within the jitter is searched
            in every case.

    Returns:
        Dataset over `case`, each variable of shape (cases,). The varied keys are coordinates, and
        the names of the metrics end in their units (see `CaseMetrics`). A metric that a case does
        not have is nan; `state` and `status` say why. With `worst` there are the variables
        `worst_METRIC` (inf if the loop is unstable), `worst_cases`, the number of cases of the
        search, and `worst_latencies_us` of shape (cases, samples), as in
        `controller.latency_trace`.

    Raises:
        DesignError: the ranges cannot be used, or `worst` does not fit the scene.
        SceneError: the scene cannot be simulated.
        SweepFailed: a worker process was lost.
    """
    from hertzloop.studies.sweeps.design import as_axis, design_of
    from hertzloop.studies.sweeps.evaluate import evaluate
    from hertzloop.studies.sweeps.pool import local_pool
    from hertzloop.studies.sweeps.worst_design import with_worst

    views = labelled_arrays()  # before the work, since a package may be missing
    axes = [as_axis(key, values) for key, values in over.items()]
    setup = resolved(scene)
    planned = design_of(setup, axes, design, cases, setup.seed)
    if worst is not None:
        planned = with_worst(setup, planned, worst)
    with local_pool(workers) as pool:
        rows = evaluate(pool, setup, span, planned.cases())
    return views.cases_of(rows, list(over), {"scene": setup.scene.name, "span": span})


def tune(
    scene: AnyScene | Sequence[AnyScene],
    laws: Sequence[str] = (),
    *,
    minimise: Sequence[str] = ("plate_energy_db", "rebound_percent"),
    at_most: Mapping[str, float] | None = None,
    over: Mapping[str, Range] | None = None,
    span: Literal["impact", "run"] = "impact",
    generations: int = 25,
    population: int = 40,
    seed: int = 1,
    workers: int | None = None,
) -> "list[Candidate]":
    """Search the Pareto-optimal settings of laws (NSGA-II, Deb et al. 2002).

    Args:
        scene: the scene, or its name or TOML file; or several, of which the worst counts.
        laws: names or files of laws; the law of the scene if empty.
        minimise: names of the metrics to minimise, as in `CaseMetrics`.
        at_most: largest allowed values by metric.
        over: ranges by scene key, in place of the usual ranges of the law.
        span: "impact" for the first impact, "run" for all contacts.
        generations: number of generations.
        population: settings in a generation.
        seed: seed of the search.
        workers: number of processes; None for one per core.

    Returns:
        The settings that no other setting beats, best first.

    Raises:
        DesignError: a range or a metric cannot be used.
        SceneError: a scene cannot be simulated.
        SweepFailed: a worker process was lost.
    """
    need("pymoo")
    from hertzloop.studies import tuning
    from hertzloop.studies.requests import TuneRequest
    from hertzloop.studies.sweeps.design import as_axis
    from hertzloop.studies.sweeps.pool import local_pool

    bases = [resolved(one) for one in ([scene] if isinstance(scene, AnyScene) else scene)]
    given = tuple(as_axis(key, values) for key, values in (over or {}).items())
    search = TuneRequest(
        tuple(minimise), span, generations, population, seed=seed, at_most=dict(at_most or {})
    )
    with local_pool(workers) as pool:
        return tuning.best_of(pool, bases, laws or [bases[0].law_reference], given, search)


def linear(scene: AnyScene | Setup, quantity: str | None = None) -> "LinearSystem":
    """Return the sampled response of the plant in flight to the force of the actuator.

    Args:
        scene: the scene, or its name, TOML file or setup.
        quantity: "v_p" (m/s), "acceleration" (m/s^2) or "xi" (m); that of the scene by default.

    Returns:
        Poles, residues and finite impulse response, with methods for frequency response, state
        space, python-control and files.

    Raises:
        SceneError: the scheme or the quantity has no such response.
    """
    from hertzloop.studies.margin.system import LinearSystem

    return LinearSystem.of(scene if isinstance(scene, Setup) else resolved(scene), quantity)
