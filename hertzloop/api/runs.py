"""Runs for scripts: simulate, run, read and compare."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hertzloop.api.parameters import with_parameter_names, with_run_options
from hertzloop.api.scenes import AnyScene, resolved
from hertzloop.bus.sockets import own_folder
from hertzloop.common.optional_dependencies import need
from hertzloop.loop.run_options import OptionError, RunOptions
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.plant.time_series import TRUTH
from hertzloop.scene.scene import Scene
from hertzloop.scene.setup import Setup, resolve
from hertzloop.views.labels import FORCE_LABEL, HELD, sensed_label

if TYPE_CHECKING:
    import xarray as xr

    from hertzloop.bus.messages_pb2 import EnergyBalance as EnergyBalance
    from hertzloop.plant.plant import Balance
    from hertzloop.recordings.recording import Event
    from hertzloop.results.inspection import Assessment
    from hertzloop.results.metric_rows import MetricRow
    from hertzloop.results.metrics import RunResult
    from hertzloop.results.span_metrics import RunMetrics
    from hertzloop.views.metrics_table import Comparison

_LINES = 6  # of a run that is printed


@dataclass(frozen=True, repr=False)
class Run:
    """A simulated run, from memory or from a recording.

    Attributes:
        scene: the scene, as simulated.
        impacts: the contacts, in order.
        noise: noise metrics, one for each contact.
        energy_residual: missing part of the energy balance, relative.
        momentum_residual: missing part of the momentum balance, relative.
        events: events of a recording; empty without one.
        path: the recording, if one was kept.
        pacing: late forces and response times of a paced run, as in `hertzloop inspect --json`.
        note: note in the recording; empty without one.
    """

    scene: Scene
    impacts: list[Impact]
    noise: list[ImpactNoise]
    energy_residual: float
    momentum_residual: float
    events: "list[Event]" = field(default_factory=list)
    path: Path | None = None
    pacing: dict[str, Any] | None = None
    note: str = ""
    _compute_result: Callable[[], "RunResult"] | None = field(
        default=None, repr=False, compare=False
    )
    _streams: "_Streams | None" = field(default=None, repr=False, compare=False)
    _why_not: str = field(default="", repr=False, compare=False)

    @cached_property
    def truth(self) -> "xr.Dataset":
        """The time series, with unit and meaning in `attrs`.

        Dataset over `step`, one variable a column, each of shape (steps,): gap `xi_m`, sphere
        `xi_s_m`, plate `xi_p_m` (m), plate velocity `v_p_m_s` (m/s), contact force `f_c_n` and
        actuator force `f_a_n` (N, means of a step). Needs the extra `python`.
        """
        assert self._streams is not None
        return labelled_arrays().truth_of(self._streams.columns, self._streams.setup.run.step_s)

    @cached_property
    def samples(self) -> "xr.DataArray":
        """Measured samples, shape (samples,), in the unit of the sensed quantity.

        Needs the extra `python`.
        """
        assert self._streams is not None
        values, setup = self._streams.values, self._streams.setup
        time_s = np.arange(len(values)) * (setup.sensor.every_steps * setup.run.step_s)
        return labelled_arrays().labelled(
            values, sensed_label(setup.scene.sensors.quantity), "sample", time_s
        )

    @cached_property
    def force(self) -> "xr.DataArray | None":
        """Commanded forces, N, shape (steps,); None for a run that was not recorded.

        Needs the extra `python`.
        """
        assert self._streams is not None
        values = self._streams.commanded
        if values is None:
            return None
        time_s = np.arange(len(values)) * self._streams.setup.run.step_s
        return labelled_arrays().labelled(values, FORCE_LABEL, "step", time_s)

    @cached_property
    def _result(self) -> "RunResult":
        assert self._compute_result is not None
        return self._compute_result()

    @property
    def metrics(self) -> "RunMetrics":
        """Metrics of the first impact and of the whole run, SI units.

        `hertzloop run` and `hertzloop inspect` print these metrics.
        """
        from hertzloop.results.span_metrics import RunMetrics

        found = self._result.metrics
        return RunMetrics(found.first_impact, found.whole_run)

    @cached_property
    def _assessment(self) -> "Assessment":
        from hertzloop.results.inspection import assess
        from hertzloop.results.metrics import free_metrics

        setup = resolve(self.scene)
        return assess(setup, self._result, free_metrics(setup), self._why_not)

    @property
    def verdict(self) -> list[str]:
        """Sentences of the verdict that `hertzloop run` prints.

        The property simulates the run without control, and repeats the run at other touch phases.
        """
        from hertzloop.views.verdict import verdict_sentences

        return verdict_sentences(self._assessment)

    @property
    def rows(self) -> "Sequence[MetricRow]":
        """Metrics with their errors, their ranges over the touch phase, and the values without
        control; computed as for `verdict`.
        """
        return self._assessment.rows

    def __str__(self) -> str:
        """The scene, the verdict and the recording, in at most six lines."""
        lines = [f"Scene {self.scene.name}, law {self.scene.controller.law}."]
        found = self.verdict[: _LINES - 1 - (self.path is not None)]
        recording = [f"Recording: {self.path}"] if self.path else []
        return "\n".join([*lines, *found, *recording])

    def __repr__(self) -> str:
        of = f", recording {str(self.path)!r}" if self.path else ""
        return f"<Run of {self.scene.name}, {len(self.impacts)} contacts{of}>"

    def without_control(self) -> "Run":
        """Simulate the run with the law off, on the same plate model.

        Returns:
            The run without control.
        """
        return simulate(resolve(self.scene).without_control(same_plate=True).scene)


@dataclass(frozen=True)
class _Streams:
    """Arrays of a run."""

    setup: Setup
    columns: Mapping[str, np.ndarray]
    values: np.ndarray
    commanded: np.ndarray | None = None


def labelled_arrays() -> Any:
    """Return the module that labels arrays; it needs a package that an extra brings."""
    need("xarray")
    return import_module("hertzloop.views.labelled")


@with_parameter_names
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
    from hertzloop.loop.plant_streams import truth_columns
    from hertzloop.loop.simulate import simulate as simulate_setup
    from hertzloop.results.metrics import RunResult, metrics_of

    setup = resolved(scene)
    found = simulate_setup(setup)
    truth, balance = found.truth, found.balance

    def compute_result() -> RunResult:
        return RunResult(
            metrics_of(setup, truth),
            setup.scene.controller.law,
            setup.expected_error,
            balance.injected_j,
            balance.dent_m,
        )

    columns = truth_columns(truth, setup, setup.plant.same_point)
    return _run_from(setup, truth, _Streams(setup, columns, found.values), balance, compute_result)


@with_run_options
@with_parameter_names
def run(
    scene: AnyScene,
    recording: str | Path | None = None,
    *,
    on_progress: Callable[[int], None] = lambda step: None,
    **options: Any,
) -> Run:
    """Run a scene, by default as processes over zenoh, and record it.

    Args:
        scene: the scene, or its name or TOML file.
        recording: MCAP file to write; without one, the run is kept in memory only.
        on_progress: called with the number of finished steps.

    Returns:
        The run, as read from its recording.

    Raises:
        SceneError: the scene cannot be run, or not at this `pace`.
        OptionError: an option has an impossible value; `recording` has another ending, its folder
            does not exist, or it exists and may not be replaced; or two options exclude each other.
        RunFailed: a process failed.
        BusError: a process is missing or was lost.
        StreamFault: a message was lost, repeated or malformed.
        RecordingError: the recording cannot be written.
    """
    from hertzloop.processes.record import record, told_where

    asked = RunOptions(**options)
    if recording is not None:
        _check_recording(Path(recording), asked.overwrite)
    setup = resolved(scene)
    if asked.pace is not None:
        from hertzloop.loop.paced import check_pace
        from hertzloop.warmup import ensure_compiled

        check_pace(setup, asked.pace, asked.timeout_s)
        ensure_compiled(setup)  # a process that compiles answers nobody
    if recording is not None:
        with told_where(Path(recording)):
            record(setup, Path(recording), asked, lambda _: nullcontext(on_progress))
        return read(recording)
    with own_folder() as folder:
        path = Path(folder) / "run.mcap"
        record(setup, path, asked, lambda _: nullcontext(on_progress))
        return replace(read(path), path=None)


def _check_recording(path: Path, overwrite: bool) -> None:
    """Raise OptionError unless a recording of this name can be written, before processes start."""
    if path.suffix != ".mcap":
        why = "must end in .mcap. Change the name"
    elif not path.parent.is_dir():
        why = f"the folder {path.parent} does not exist. Create it"
    elif path.exists() and not overwrite:
        why = "exists. Choose another name, or use overwrite=True"
    else:
        return
    raise OptionError(f"recording = '{path}': {why}.")


@with_parameter_names
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
    from hertzloop.recordings.reader import read as read_recording
    from hertzloop.recordings.writer import RecordingError
    from hertzloop.results.inspection import recorded_result
    from hertzloop.results.metrics import metrics_of
    from hertzloop.results.recorded import law_of, pacing_of, setup_of, truth_of, why_not_repeatable
    from hertzloop.views.run_json import pacing_as_json

    found = read_recording(Path(recording))
    if found.problems or found.balance is None:
        raise RecordingError(
            f"{recording}: {[*found.problems, 'the run has no energy balance'][0]}. To see what "
            "it holds, use hertzloop inspect, export or replay --alone."
        )
    setup, truth, law, pacing = setup_of(found), truth_of(found), law_of(found), pacing_of(found)
    names = [name for name in (*TRUTH, *HELD) if name in found.truth.arrays]
    columns = {name: found.truth.arrays[name] for name in names}
    commanded = found.force.arrays.get("force_n", np.empty(0))
    return _run_from(
        setup,
        truth,
        _Streams(setup, columns, found.daq.values, commanded),
        found.balance,
        lambda: recorded_result(setup, found, metrics_of(setup, truth), law, pacing),
        events=found.events,
        path=found.path,
        pacing=pacing_as_json(pacing),
        note=found.note,
        _why_not=why_not_repeatable(found),
    )


def _run_from(
    setup: Setup,
    truth: np.ndarray,
    streams: _Streams,
    balance: "Balance | EnergyBalance",
    compute_result: Callable[[], "RunResult"],
    **recorded: Any,
) -> Run:
    """Return a run; `recorded`: the fields of `Run` that a recording has beside."""
    from hertzloop.results.impacts import impacts_of

    found = impacts_of(setup, truth)
    return Run(
        scene=setup.scene,
        impacts=[one.impact for one in found],
        noise=[one.noise for one in found],
        energy_residual=balance.energy_residual,
        momentum_residual=balance.momentum_residual,
        _compute_result=compute_result,
        _streams=streams,
        **recorded,
    )


@with_parameter_names
def compare(a: "Run | RunMetrics", b: "Run | RunMetrics") -> "Comparison":
    """Compare the metrics of two runs.

    Args:
        a: the reference.
        b: the run to compare with it. Of bare metrics no error is known.

    Returns:
        One row per metric. `print` shows the table of `hertzloop compare --metrics`.
    """
    from hertzloop.results.metric_rows import comparison, values_in, without_errors
    from hertzloop.views.metrics_table import Comparison

    left, right = (
        values_in(one.rows) if isinstance(one, Run) else without_errors(one) for one in (a, b)
    )
    return Comparison(comparison(left, right))
