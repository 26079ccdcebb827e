"""The Python interface: scenes, runs, recordings, sweeps and tuning as functions and objects.

`import hertzloop` offers these names; the command line is made of the same parts.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from hertzloop.bus.sockets import own_folder
from hertzloop.plant.figures.impacts import Impact
from hertzloop.plant.figures.noise import ImpactNoise
from hertzloop.plant.time_series import TRUTH
from hertzloop.scenes import scene as scenes
from hertzloop.scenes.errors import SceneError
from hertzloop.scenes.scene import Scene, shipped, vary
from hertzloop.setup import Setup, resolve
from hertzloop.views.labelled import FORCE_LABEL, HELD, cases_of, labelled, sensed_label, truth_of

if TYPE_CHECKING:
    import xarray as xr

    from hertzloop.analysis.figures import Ran
    from hertzloop.analysis.spans import Comparison, Difference, RunFigures, SpanFigures
    from hertzloop.analysis.trust import NotAgain
    from hertzloop.bus.messages_pb2 import Books as BooksMessage
    from hertzloop.bus.port import BusError
    from hertzloop.bus.streams import StreamFault
    from hertzloop.plant.plant import Balance
    from hertzloop.processes.launcher import RunFailed, RunOptions
    from hertzloop.recordings.reader import Event, Recording
    from hertzloop.recordings.writer import RecordingError
    from hertzloop.studies.fit.fit import FitError, FitResult
    from hertzloop.studies.fit.records import Record, RecordError
    from hertzloop.studies.margin.system import LinearSystem
    from hertzloop.studies.sweeps.design import DesignError
    from hertzloop.studies.sweeps.pool import SweepFailed
    from hertzloop.studies.tuning import Found

__all__ = [
    "BusError", "Comparison", "DesignError", "Difference", "FitError", "FitResult", "Impact",
    "ImpactNoise", "Record", "RecordError", "RecordingError", "Run", "RunFailed", "RunFigures",
    "Scene", "SceneError", "SpanFigures", "StreamFault", "SweepFailed", "compare", "fit", "linear",
    "load", "modes", "read", "read_record", "run", "scene_names", "simulate", "sweep", "tune",
    "vary",
]  # fmt: skip

# Names that are loaded when they are used: a script that only simulates needs none of them.
_LATER = {
    "BusError": "hertzloop.bus.port",
    "Comparison": "hertzloop.analysis.spans",
    "DesignError": "hertzloop.studies.sweeps.design",
    "Difference": "hertzloop.analysis.spans",
    "FitError": "hertzloop.studies.fit.fit",
    "FitResult": "hertzloop.studies.fit.fit",
    "Record": "hertzloop.studies.fit.records",
    "RecordError": "hertzloop.studies.fit.records",
    "RecordingError": "hertzloop.recordings.writer",
    "RunFailed": "hertzloop.processes.launcher",
    "RunFigures": "hertzloop.analysis.spans",
    "SpanFigures": "hertzloop.analysis.spans",
    "StreamFault": "hertzloop.bus.streams",
    "SweepFailed": "hertzloop.studies.sweeps.pool",
}

TransportName = Literal["zenoh", "inprocess", "compiled"]
Range = str | Sequence[Any]


def __getattr__(name: str) -> Any:
    if name in _LATER:
        return getattr(import_module(_LATER[name]), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")


@dataclass(frozen=True)
class Run:
    """A simulated run, from memory or from a recording.

    `truth`: a Dataset over `step` of gap, displacements, forces; `samples`: what the law saw,
    over `sample`; `force`: what it commanded, over `step` (None where it was not kept).
    `impacts` and `noise`: one a contact. `energy_residual`, `momentum_residual`: of the balances,
    relative. `events`: of a recording; empty otherwise. `path`: the recording, if there is one.
    `pacing`: of a run by the wall clock, what it missed and how fast it was answered, in the words
    of `inspect --json`; its `truth` has `held_steps`. None otherwise.
    """

    scene: Scene
    truth: "xr.Dataset"
    samples: "xr.DataArray"
    force: "xr.DataArray | None"
    impacts: list[Impact]
    noise: list[ImpactNoise]
    energy_residual: float
    momentum_residual: float
    events: "list[Event]"
    path: Path | None = None
    pacing: dict[str, Any] | None = None
    _ran: Callable[[], "Ran"] | None = field(default=None, repr=False, compare=False)
    _not_again: "NotAgain | None" = field(default=None, repr=False, compare=False)

    @cached_property
    def _judged(self) -> "Ran":
        assert self._ran is not None
        return self._ran()

    @property
    def figures(self) -> "RunFigures":
        """Figures of the first impact and of the whole run, as `run` and `inspect` print them."""
        from hertzloop.analysis.spans import RunFigures

        found = self._judged.figures
        return RunFigures(found.first_impact, found.whole_run)

    @cached_property
    def verdict(self) -> list[str]:
        """What the run comes to, in the sentences of `hertzloop run`. This simulates the same run
        without control."""
        from hertzloop.analysis.figures import free_figures
        from hertzloop.analysis.verdict import conclusions
        from hertzloop.views.sentences import verdict_sentences

        setup = resolve(self.scene)
        found = conclusions(setup, self._judged, free_figures(setup), self._not_again)
        return verdict_sentences(found.verdict)

    def without_control(self) -> "Run":
        """The same run with the law off, on the same model of the plate, simulated on the spot."""
        return simulate(resolve(self.scene).uncontrolled().scene)


def scene_names() -> list[str]:
    """Names of the shipped scenes."""
    return shipped()


def load(source: str | Path, changes: Mapping[str, Any] | None = None) -> Scene:
    """A scene by shipped name or from a TOML file, with `changes` such as
    {"controller.latency_us": 5}. Raises SceneError with one sentence for anything wrong."""
    scene = scenes.load(str(source))
    return vary(scene, changes) if changes else scene


def simulate(scene: Scene) -> Run:
    """Simulate a scene in this process, in one compiled loop, and keep the result in memory.

    The samples are the same bytes as over the bus. Raises SceneError.
    """
    from hertzloop.loop import compiled
    from hertzloop.loop.plant_streams import truth_columns

    setup = resolve(scene)
    found = compiled.simulate(setup)
    columns = truth_columns(found.rows, setup, setup.plant.same_point)
    return _run(setup, found.rows, columns, found.values, None, found.books)


def run(
    scene: Scene,
    recording: str | Path | None = None,
    *,
    transport: TransportName = "zenoh",
    overwrite: bool = False,
    horizon: int | None = None,
    pace: float | None = None,
    on_progress: Callable[[int], None] = lambda step: None,
) -> Run:
    """Run a scene, by default as processes over zenoh, and record it.

    `recording` is the MCAP file to write; without one the run is kept in memory only. With a
    `pace` (simulated over wall time, 1 is real time) the plant follows the wall clock and waits
    for no force; without, processes are in lock-step. Raises SceneError, RunFailed, BusError,
    StreamFault or RecordingError with one sentence.
    """
    from hertzloop.processes.launcher import RunOptions, Transport, record

    options = RunOptions(Transport(transport), overwrite=overwrite, horizon=horizon, pace=pace)
    if pace is not None:
        _check_pace(resolve(scene), options)
    if recording is not None:
        record(resolve(scene), Path(recording), options, on_progress)
        return read(recording)
    with own_folder() as folder:
        path = Path(folder) / "run.mcap"
        record(resolve(scene), path, options, on_progress)
        return replace(read(path), path=None)


def _check_pace(setup: Setup, options: "RunOptions") -> None:
    """Raise SceneError for a run that cannot be by the wall clock."""
    from hertzloop.loop.paced import check_pace
    from hertzloop.processes.launcher import Transport
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
    ensure_compiled(lambda: None, setup, paced=True)


def read(recording: str | Path) -> Run:
    """A recording as a run. Raises RecordingError if it is damaged, no recording, or its scene
    cannot be simulated here."""
    from hertzloop.analysis.recorded import rows_of
    from hertzloop.recordings.reader import read as read_file
    from hertzloop.recordings.writer import RecordingError

    found = read_file(Path(recording))
    if found.problems or found.books is None:
        raise RecordingError(
            f"{recording}: {[*found.problems, 'the run has no energy balance'][0]}"
        )
    try:
        scene = scenes.parse(found.scene_toml)
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
    from hertzloop.views.data import pacing_as_json

    step_s = setup.step_s
    sampled_s = np.arange(len(values)) * setup.every_steps * step_s
    label = sensed_label(setup.quantity)
    found = impacts_of_rows(setup, rows)
    truth = truth_of(columns, step_s)
    law, not_again, saturation, pacing = setup.law_reference, None, None, None
    if recording is not None:
        law, not_again = law_of(recording).scene_law or "", why_not_again(recording)
        saturation, pacing = saturation_of(recording.events), pacing_of(recording)

    def ran() -> Ran:
        return Ran(
            figures_of(setup, stacked(dict(columns))), law, setup.expected_error,
            books.injected_j, books.dent_m, pacing is not None, saturation,
            setup.law_models_yield,
        )  # fmt: skip

    force = None
    if recording is not None:
        commanded = recording.force.arrays.get("force_n", np.empty(0))
        force = labelled(commanded, FORCE_LABEL, "step", np.arange(len(commanded)) * step_s)
    return Run(
        scene=setup.scene,
        truth=truth,
        samples=labelled(values, label, "sample", sampled_s),
        force=force,
        impacts=[one.impact for one in found],
        noise=[one.noise for one in found],
        energy_residual=books.energy_residual,
        momentum_residual=books.momentum_residual,
        events=recording.events if recording is not None else [],
        path=recording.path if recording is not None else None,
        pacing=pacing_as_json(pacing),
        _ran=ran,
        _not_again=not_again,
    )


def compare(a: "Run | RunFigures", b: "Run | RunFigures") -> "Comparison":
    """Compare the figures of two runs; `print` shows the table of `hertzloop compare --figures`."""
    from hertzloop.analysis.spans import compared
    from hertzloop.views.inspection import PrintedComparison

    found = compared(*(one.figures if isinstance(one, Run) else one for one in (a, b)))
    return PrintedComparison(found.rows)


def modes(scene: Scene) -> "xr.Dataset":
    """The modes that a scene's plant computes with, a Dataset over `mode` with the columns of the
    file that `hertzloop scene modes` writes. Raises SceneError."""
    from hertzloop.analysis.deflection import modes_of_scene
    from hertzloop.views.labelled import modes_of

    return modes_of(modes_of_scene(resolve(scene)))


def sweep(
    scene: Scene,
    over: Mapping[str, Range],
    *,
    design: Literal["grid", "lhs", "sobol"] = "grid",
    cases: int = 256,
    span: Literal["impact", "run"] = "impact",
    workers: int | None = None,
) -> "xr.Dataset":
    """Figures of a scene over ranges of its keys, a Dataset over `case`.

    `over`: key to values, or to "low:high:step" (a grid), "low:high" (to be spread) as on the
    command line. All combinations, or `cases` points spread over the ranges. Raises
    DesignError, SceneError, SweepFailed.
    """
    from hertzloop.studies.sweeps.design import as_axis, design_of
    from hertzloop.studies.sweeps.evaluate import evaluate
    from hertzloop.studies.sweeps.pool import local_pool

    axes = [as_axis(key, values) for key, values in over.items()]
    setup = resolve(scene)
    planned = design_of(setup, axes, design, cases, setup.seed)
    with local_pool(workers) as pool:
        rows = evaluate(pool, setup, span, planned.cases())
    return cases_of(rows, list(over), {"scene": scene.name, "span": span})


def tune(
    scene: Scene | Sequence[Scene],
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
    """Settings of the laws (the scene's own if none is named) that no other beats in the figures
    to `minimise`, best first; of several scenes the worst counts.

    `over`: ranges of keys other than a law's usual ones; `at_most`: largest values of figures.
    Raises DesignError, SceneError, SweepFailed.
    """
    from hertzloop.studies import tuning as study
    from hertzloop.studies.sweeps.design import as_axis
    from hertzloop.studies.sweeps.pool import local_pool

    bases = [resolve(one) for one in ([scene] if isinstance(scene, Scene) else scene)]
    given = tuple(as_axis(key, values) for key, values in (over or {}).items())
    with local_pool(workers) as pool:
        return study.best_of(
            pool, bases, span, laws or [bases[0].law_reference], given, tuple(minimise),
            at_most=dict(at_most or {}), generations=generations, population=population, seed=seed,
        )  # fmt: skip


def read_record(path: str | Path, **table: Any) -> "Record":
    """A measured record from a file; `table`: keys of its `[record]` table, which replace those of
    the file. Raises RecordError."""
    from hertzloop.studies.fit.records import read_record as read_file

    return read_file(Path(path), table)


def fit(
    scene: Scene, records: "Record | Sequence[Record]", free: Sequence[str], *,
    hold_out: "Sequence[Record]" = (),
) -> "FitResult":  # fmt: skip
    """Fit keys of a scene to measured records of drops without control.

    `free`: keys as on the command line, "KEY[=LOW:HIGH][±PRIOR]". The result holds estimates with
    95 % intervals and verdicts, and `setup.scene`, the fitted scene. Raises RecordError, FitError,
    SceneError.
    """
    from hertzloop.studies.fit.fit import fit as study
    from hertzloop.studies.fit.fit import free_of
    from hertzloop.studies.fit.records import Record

    setup = resolve(scene)
    several = [records] if isinstance(records, Record) else list(records)
    return study(setup, several, [free_of(setup, text) for text in free], hold_out)


def linear(scene: Scene | Setup, quantity: str | None = None) -> "LinearSystem":
    """Return the sampled response of the plant in flight to the force of the actuator.

    Args:
        scene: the scene, or its setup.
        quantity: "v_p" (m/s), "acceleration" (m/s^2) or "xi" (m); that of the scene if not given.

    Returns:
        Poles, residues and finite impulse response, with methods for frequency response, state
        space, python-control and files.

    Raises:
        SceneError: the scheme or the quantity has no such response.
    """
    from hertzloop.studies.margin.system import LinearSystem

    return LinearSystem.of(scene if isinstance(scene, Setup) else resolve(scene), quantity)
