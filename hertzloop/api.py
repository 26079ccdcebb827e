"""The Python interface: scenes, runs, recordings, sweeps, tuning and fits.

`import hertzloop` offers these names. The command line uses the same functions.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hertzloop.bus.sockets import own_folder
from hertzloop.extras import need
from hertzloop.plant.figures.impacts import Impact
from hertzloop.plant.figures.noise import ImpactNoise
from hertzloop.plant.time_series import TRUTH
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.loading import load as load_scene
from hertzloop.scenes.loading import parse as parse_scene
from hertzloop.scenes.loading import shipped
from hertzloop.scenes.scene import Scene
from hertzloop.scenes.varying import vary as vary_scene
from hertzloop.scenes.varying import with_law_as_it_is
from hertzloop.setup import Setup, model_error, resolve
from hertzloop.views.labels import FORCE_LABEL, HELD, sensed_label

if TYPE_CHECKING:
    import xarray as xr

    from hertzloop.analysis.figures import Ran
    from hertzloop.analysis.meters import Comparison, Difference, RunFigures, SpanFigures
    from hertzloop.analysis.trust import NotAgain
    from hertzloop.bus.messages_pb2 import Books as BooksMessage
    from hertzloop.bus.port import BusError
    from hertzloop.bus.streams import StreamFault
    from hertzloop.loop.run_options import RunOptions
    from hertzloop.plant.plant import Balance
    from hertzloop.processes.launcher import RunFailed
    from hertzloop.recordings.recording import Event, Recording
    from hertzloop.recordings.writer import RecordingError
    from hertzloop.studies.fit.fit import FitError, FitResult
    from hertzloop.studies.fit.records import Record, RecordError
    from hertzloop.studies.margin.system import LinearSystem
    from hertzloop.studies.sweeps.design import DesignError
    from hertzloop.studies.sweeps.pool import SweepFailed
    from hertzloop.studies.tuning import Found

__all__ = [
    "BusError", "Comparison", "DesignError", "Difference", "FitError", "FitResult", "Impact",
    "ImpactNoise", "Record", "RecordError", "RecordingError", "Run", "RunFailed",
    "RunFigures", "Scene", "SceneError", "SpanFigures", "StreamFault", "SweepFailed", "compare",
    "fit", "linear", "load", "modes", "read", "read_record", "read_records", "run", "scene_names",
    "simulate", "sweep", "tune", "vary",
]  # fmt: skip

# Names that are loaded when they are used: a script that only simulates needs none of them.
_OF_MODULES = {
    "analysis.meters": ("Comparison", "Difference", "RunFigures", "SpanFigures"),
    "bus.port": ("BusError",),
    "bus.streams": ("StreamFault",),
    "interop.environment": ("ImpactEnv",),
    "processes.launcher": ("RunFailed",),
    "recordings.writer": ("RecordingError",),
    "studies.fit.fit": ("FitError", "FitResult"),
    "studies.fit.records": ("Record", "RecordError"),
    "studies.sweeps.design": ("DesignError",),
    "studies.sweeps.pool": ("SweepFailed",),
}
_LATER = {name: module for module, names in _OF_MODULES.items() for name in names}

TransportName = Literal["zenoh", "inprocess", "compiled"]
Range = str | Sequence[Any]
AnyScene = Scene | str | Path  # a scene, the name of a shipped one, or a TOML file


def __getattr__(name: str) -> Any:
    if name == "ImpactEnv":
        need("gymnasium")
    if name in _LATER:
        return getattr(import_module(f"hertzloop.{_LATER[name]}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


@dataclass(frozen=True)
class Run:
    """A simulated run, from memory or from a recording.

    Attributes:
        scene: the scene, as simulated.
        impacts: the contacts, in order.
        noise: noise figures, one for each contact.
        energy_residual: missing part of the energy balance, relative.
        momentum_residual: missing part of the momentum balance, relative.
        events: events of a recording; empty without one.
        path: the recording, if one was kept.
        pacing: late forces and response times of a paced run, with the names of
            `hertzloop inspect --json`; None in lock-step.
    """

    scene: Scene
    impacts: list[Impact]
    noise: list[ImpactNoise]
    energy_residual: float
    momentum_residual: float
    events: "list[Event]"
    path: Path | None = None
    pacing: dict[str, Any] | None = None
    _ran: Callable[[], "Ran"] | None = field(default=None, repr=False, compare=False)
    _streams: "_Streams | None" = field(default=None, repr=False, compare=False)
    _not_again: "NotAgain | None" = field(default=None, repr=False, compare=False)

    @cached_property
    def truth(self) -> "xr.Dataset":
        """The time series, with unit and meaning in `attrs`.

        Dataset over `step`, one variable a column, each of shape (steps,): gap `xi_m`, sphere
        `xi_s_m`, plate `xi_p_m` (m), plate velocity `v_p_m_s` (m/s), contact force `f_c_n` and
        actuator force `f_a_n` (N, means of a step). Needs the extra `python`.
        """
        assert self._streams is not None
        return _views().truth_of(self._streams.columns, self._streams.step_s)

    @cached_property
    def samples(self) -> "xr.DataArray":
        """Measured samples, shape (samples,), in the unit of the sensed quantity.

        Needs the extra `python`.
        """
        assert self._streams is not None
        values, every_s = self._streams.values, self._streams.sample_s
        label = sensed_label(self._streams.quantity)
        return _views().labelled(values, label, "sample", np.arange(len(values)) * every_s)

    @cached_property
    def force(self) -> "xr.DataArray | None":
        """Commanded forces, N, shape (steps,); None for a run that was not recorded.

        Needs the extra `python`.
        """
        assert self._streams is not None
        values, step_s = self._streams.commanded, self._streams.step_s
        if values is None:
            return None
        return _views().labelled(values, FORCE_LABEL, "step", np.arange(len(values)) * step_s)

    @cached_property
    def _judged(self) -> "Ran":
        assert self._ran is not None
        return self._ran()

    @property
    def figures(self) -> "RunFigures":
        """Figures of the first impact and of the whole run, SI units.

        `hertzloop run` and `hertzloop inspect` print these figures.
        """
        from hertzloop.analysis.meters import RunFigures

        found = self._judged.figures
        return RunFigures(found.first_impact, found.whole_run)

    @cached_property
    def verdict(self) -> list[str]:
        """Sentences of the verdict that `hertzloop run` prints.

        The property simulates the run without control.
        """
        from hertzloop.analysis.figures import free_figures
        from hertzloop.analysis.verdict import conclusions
        from hertzloop.views.run import verdict_sentences

        setup = resolve(self.scene)
        found = conclusions(setup, self._judged, free_figures(setup), self._not_again)
        return verdict_sentences(found.verdict)

    def without_control(self) -> "Run":
        """Simulate the run with the law off, on the same plate model.

        Returns:
            The run without control.
        """
        return simulate(resolve(self.scene).without_control(same_plate=True).scene)


@dataclass(frozen=True)
class _Streams:
    """Arrays of a run and what labels them."""

    columns: Mapping[str, np.ndarray]
    values: np.ndarray
    commanded: np.ndarray | None
    quantity: str
    step_s: float
    sample_s: float


def scene_names() -> list[str]:
    """Return the names of the shipped scenes."""
    return shipped()


def load(source: str | Path, changes: Mapping[str, Any] | None = None) -> Scene:
    """Load a scene.

    Args:
        source: name of a shipped scene, or a TOML file.
        changes: values by scene key, for example {"controller.latency_us": 5}.

    Returns:
        The scene, checked.

    Raises:
        SceneError: the file cannot be read, or a key or a value is wrong.
    """
    scene = load_scene(str(source))
    return vary_scene(scene, changes) if changes else scene


def vary(scene: AnyScene, values: Mapping[str, Any]) -> Scene:
    """Return a scene with other values.

    Args:
        scene: the scene, which stays as it is; or its name or TOML file.
        values: new values by scene key, for example {"sphere.radius_m": 0.004}.

    Raises:
        SceneError: a key is unknown, or a value is not possible.
    """
    return vary_scene(_current(scene), values)


def _current(scene: AnyScene) -> Scene:
    """Return a scene with its law as that is now. Raises SceneError."""
    return with_law_as_it_is(scene) if isinstance(scene, Scene) else load(scene)


def _views() -> Any:
    """Return the module that labels arrays; it needs a package that an extra brings."""
    need("xarray")
    return import_module("hertzloop.views.labelled")


def _resolved(scene: AnyScene) -> Setup:
    """Return a scene as it is to be simulated, with its law as that is now. Raises SceneError."""
    from hertzloop.processes.law_trial import check_repeatable  # an own law needs it, no other

    setup = resolve(_current(scene))
    if not setup.law_is_shipped:
        check_repeatable(setup)
    return setup


def simulate(scene: AnyScene) -> Run:
    """Simulate a scene in this process, in one compiled loop.

    The samples have the same bytes as those of a run over the bus.

    Args:
        scene: the scene, or its name or TOML file.

    Returns:
        The run, in memory. It has no `force` and no `events`.

    Raises:
        SceneError: the scene cannot be simulated.
    """
    from hertzloop.loop import compiled
    from hertzloop.loop.plant_streams import truth_columns

    setup = _resolved(scene)
    found = compiled.simulate(setup)
    columns = truth_columns(found.rows, setup, setup.plant.same_point)
    return _run(setup, found.rows, columns, found.values, None, found.books)


def run(
    scene: AnyScene,
    recording: str | Path | None = None,
    *,
    transport: TransportName = "zenoh",
    overwrite: bool = False,
    horizon: int | None = None,
    pace: float | None = None,
    on_progress: Callable[[int], None] = lambda step: None,
) -> Run:
    """Run a scene, by default as processes over zenoh, and record it.

    Args:
        scene: the scene, or its name or TOML file.
        recording: MCAP file to write; without one, the run is kept in memory only.
        transport: "zenoh" (processes), "inprocess" or "compiled"; all give the same bytes.
        overwrite: whether an existing file may be replaced.
        horizon: largest number of steps that the plant may run ahead; None for the default. It
            changes the speed and no sample.
        pace: simulated time over wall time, 1 for real time: the plant follows the wall clock
            and waits for no force. None for lock-step.
        on_progress: called with the number of finished steps.

    Returns:
        The run, as read from its recording.

    Raises:
        SceneError: the scene cannot be run, or `pace` does not fit the other arguments.
        RunFailed: a process failed.
        BusError: a process is missing or was lost.
        StreamFault: a message was lost, repeated or malformed.
        RecordingError: the recording cannot be written.
    """
    from hertzloop.loop.run_options import RunOptions, Transport
    from hertzloop.processes.launcher import record

    options = RunOptions(Transport(transport), overwrite=overwrite, horizon=horizon, pace=pace)
    setup = _resolved(scene)
    if pace is not None:
        _check_pace(setup, options)
    if recording is not None:
        record(setup, Path(recording), options, on_progress)
        return read(recording)
    with own_folder() as folder:
        path = Path(folder) / "run.mcap"
        record(setup, path, options, on_progress)
        return replace(read(path), path=None)


def _check_pace(setup: Setup, options: "RunOptions") -> None:
    """Raise SceneError for a run that cannot be by the wall clock."""
    from hertzloop.loop.paced import check_pace
    from hertzloop.loop.run_options import Transport
    from hertzloop.processes.warmup import ensure_compiled

    assert options.pace is not None
    if options.transport is not Transport.ZENOH:
        raise SceneError(
            f"pace = {options.pace:g} needs processes of their own; transport = "
            f"'{options.transport}' has none"
        )
    if options.horizon is not None:
        raise SceneError(
            f"horizon = {options.horizon} needs the lock-step; with a pace the plant waits for no "
            "force"
        )
    check_pace(setup, options.pace, options.timeout_s)
    # A process that compiles answers nobody.
    ensure_compiled(setup, paced=True)


def read(recording: str | Path) -> Run:
    """Read a recording.

    Args:
        recording: MCAP file of a run.

    Returns:
        The run.

    Raises:
        RecordingError: the file cannot be read, is damaged or not a recording, or its scene
            cannot be simulated by this version.
    """
    from hertzloop.analysis.recorded import rows_of
    from hertzloop.recordings.reader import read as read_recording
    from hertzloop.recordings.writer import RecordingError

    found = read_recording(Path(recording))
    if found.problems or found.books is None:
        raise RecordingError(
            f"{recording}: {[*found.problems, 'the run has no energy balance'][0]}"
        )
    try:
        scene = parse_scene(found.scene_toml)
    except SceneError as error:
        words = f"{recording}: its scene cannot be simulated here: {error}{found.other_version}"
        raise RecordingError(words) from error
    names = [name for name in (*TRUTH, *HELD) if name in found.truth.arrays]
    kept = {name: found.truth.arrays[name] for name in names}
    return _run(resolve(scene), rows_of(found), kept, found.daq_values, found, found.books)


def _run(
    setup: Setup,
    rows: np.ndarray,
    columns: Mapping[str, np.ndarray],
    values: np.ndarray,
    recording: "Recording | None",
    books: "Balance | BooksMessage",
) -> Run:
    from hertzloop.analysis.figures import Ran, figures_of
    from hertzloop.analysis.impacts import impacts_of_rows
    from hertzloop.analysis.recorded import law_of, pacing_of, stacked
    from hertzloop.analysis.trust import why_not_again
    from hertzloop.analysis.verdict import saturation_of
    from hertzloop.views.run import pacing_as_json

    step_s = setup.step_s
    found = impacts_of_rows(setup, rows)
    law, not_again, saturation, pacing = setup.law_reference, None, None, None
    if recording is not None:
        law, not_again = law_of(recording).scene_law or "", why_not_again(recording)
        saturation, pacing = saturation_of(recording.events), pacing_of(recording)

    def ran() -> Ran:
        return Ran(
            figures_of(setup, stacked(dict(columns))), law, model_error.expected_error(setup),
            books.injected_j, books.dent_m, pacing is not None, saturation,
            setup.law_models_yield,
        )  # fmt: skip

    commanded = None
    if recording is not None:
        commanded = recording.force.arrays.get("force_n", np.empty(0))
    return Run(
        scene=setup.scene,
        impacts=[one.impact for one in found],
        noise=[one.noise for one in found],
        energy_residual=books.energy_residual,
        momentum_residual=books.momentum_residual,
        events=recording.events if recording is not None else [],
        path=recording.path if recording is not None else None,
        pacing=pacing_as_json(pacing),
        _ran=ran,
        _streams=_Streams(
            columns, values, commanded, setup.quantity, step_s, setup.every_steps * step_s
        ),
        _not_again=not_again,
    )


def compare(a: "Run | RunFigures", b: "Run | RunFigures") -> "Comparison":
    """Compare the figures of two runs.

    Args:
        a: the reference.
        b: the run to compare with it.

    Returns:
        One row per figure. `print` shows the table of `hertzloop compare --figures`.
    """
    from hertzloop.analysis.meters import compared
    from hertzloop.views.inspection import PrintedComparison

    found = compared(*(one.figures if isinstance(one, Run) else one for one in (a, b)))
    return PrintedComparison(found.rows)


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
    from hertzloop.analysis.deflection import modes_of_scene

    return _views().modes_of(modes_of_scene(_resolved(scene)))


def sweep(
    scene: AnyScene,
    over: Mapping[str, Range],
    *,
    design: Literal["grid", "lhs", "sobol"] = "grid",
    cases: int = 256,
    span: Literal["impact", "run"] = "impact",
    workers: int | None = None,
) -> "xr.Dataset":
    """Compute the figures of a scene over ranges of its keys. Needs the extra `python`.

    Args:
        scene: the scene, or its name or TOML file.
        over: by scene key a list of values, "low:high:step" (a grid) or "low:high" (to be spread).
        design: "grid" for all combinations; "lhs" or "sobol" for spread points.
        cases: number of spread points.
        span: "impact" for the first impact, "run" for all contacts.
        workers: number of processes; None for one per core.

    Returns:
        Dataset over `case`, each variable of shape (cases,). The varied keys are coordinates, and
        the names of the figures end in their units (see `CaseFigures`). A figure that a case does
        not have is nan; `state` and `status` say why.

    Raises:
        DesignError: the ranges cannot be used.
        SceneError: the scene cannot be simulated.
        SweepFailed: a worker process was lost.
    """
    from hertzloop.studies.sweeps.design import as_axis, design_of
    from hertzloop.studies.sweeps.evaluate import evaluate
    from hertzloop.studies.sweeps.pool import local_pool

    views = _views()  # before the work, since a package may be missing
    axes = [as_axis(key, values) for key, values in over.items()]
    setup = _resolved(scene)
    planned = design_of(setup, axes, design, cases, setup.seed)
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
) -> "list[Found]":
    """Search the Pareto-optimal settings of laws (NSGA-II, Deb et al. 2002).

    Args:
        scene: the scene, or its name or TOML file; or several, of which the worst counts.
        laws: names or files of laws; the law of the scene if empty.
        minimise: names of the figures to minimise, as in `CaseFigures`.
        at_most: largest allowed values by figure.
        over: ranges by scene key, in place of the usual ranges of the law.
        span: "impact" for the first impact, "run" for all contacts.
        generations: number of generations.
        population: settings in a generation.
        seed: seed of the search.
        workers: number of processes; None for one per core.

    Returns:
        The settings that no other setting beats, best first.

    Raises:
        DesignError: a range or a figure cannot be used.
        SceneError: a scene cannot be simulated.
        SweepFailed: a worker process was lost.
    """
    need("pymoo")
    from hertzloop.studies import tuning
    from hertzloop.studies.requests import TuneRequest
    from hertzloop.studies.sweeps.design import as_axis
    from hertzloop.studies.sweeps.pool import local_pool

    bases = [_resolved(one) for one in ([scene] if isinstance(scene, AnyScene) else scene)]
    given = tuple(as_axis(key, values) for key, values in (over or {}).items())
    search = TuneRequest(
        tuple(minimise), span, generations, population, seed=seed, at_most=dict(at_most or {})
    )
    with local_pool(workers) as pool:
        return tuning.best_of(pool, bases, laws or [bases[0].law_reference], given, search)


def read_record(path: str | Path, **table: Any) -> "Record":
    """Read a measured record.

    Args:
        path: a text table, or a file of another format of `hertzloop fit`.
        table: keys of the `[record]` table, which replace those of the file.

    Returns:
        The record, in SI units.

    Raises:
        RecordError: the file cannot be read, or the record cannot be used.
    """
    from hertzloop.studies.fit.records import read_record

    return read_record(Path(path), table)


def read_records(path: str | Path, **table: Any) -> "list[Record]":
    """Read the measured records of a file: one for each of its `[[record]]` tables, or one.

    Args:
        path: a file of `read_record`, or a TOML file whose `[[record]]` tables name such files.
        table: keys of the tables, which replace those of the file.

    Returns:
        The records, in SI units.

    Raises:
        RecordError: a file cannot be read, or a record cannot be used.
    """
    from hertzloop.studies.fit.records import read_records

    return read_records(Path(path), table)


def fit(
    scene: AnyScene, records: "Record | Sequence[Record]", free: Sequence[str], *,
    hold_out: "Sequence[Record | int] | None" = None, exact: bool = False,
) -> "FitResult":  # fmt: skip
    """Fit keys of a scene to measured records of drops, with the law off or on.

    Args:
        scene: the scene, or its name or TOML file, with start values.
        records: one record or several; `Record.measured.control` says whether the law was on.
        free: the keys to fit, `"KEY"`, `"KEY=LOW:HIGH"` or `"KEY±PRIOR"` as on the command line.
        hold_out: records, or numbers of hits, to compare with the fitted scene only; by default the
            last one of several hits.
        exact: whether the model is taken as exact, so that only noise may spoil a record.

    Returns:
        Estimates with 95 % intervals and verdicts; `setup.scene` is the fitted scene.

    Raises:
        RecordError: a record cannot be used.
        FitError: a key cannot be fitted.
        SceneError: the scene cannot be simulated.
    """
    from hertzloop.studies.fit.fit import fit as fitted_to
    from hertzloop.studies.fit.fit import free_of
    from hertzloop.studies.fit.records import Record

    setup = _resolved(scene)
    several = [records] if isinstance(records, Record) else list(records)
    return fitted_to(setup, several, [free_of(setup, text) for text in free], hold_out, exact=exact)


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

    return LinearSystem.of(scene if isinstance(scene, Setup) else _resolved(scene), quantity)
