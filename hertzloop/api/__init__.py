"""The Python interface: scenes, runs, recordings, studies and fits.

`import hertzloop` offers these names. The command line uses the same functions.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from hertzloop.api.runs import Run, compare, read, run, simulate
from hertzloop.api.scenes import load, scene_names, vary
from hertzloop.api.studies import (
    budget,
    fit,
    linear,
    margin,
    modes,
    read_record,
    read_records,
    sweep,
    tune,
)
from hertzloop.plant.metrics.impacts import Impact
from hertzloop.plant.metrics.noise import ImpactNoise
from hertzloop.scene.errors import SceneError
from hertzloop.scene.scene import Scene

if TYPE_CHECKING:
    from hertzloop.api.stepper import Stepper
    from hertzloop.bus.port import BusError
    from hertzloop.bus.streams import StreamFault
    from hertzloop.fitting.errors import FitError, RecordError
    from hertzloop.fitting.fit.results import FitResult
    from hertzloop.fitting.records.record import Record
    from hertzloop.loop.run_options import OptionError
    from hertzloop.processes.launcher import RunFailed
    from hertzloop.recordings.writer import RecordingError
    from hertzloop.results.span_metrics import RunMetrics, SpanMetrics
    from hertzloop.studies.budget.request import BudgetRequest
    from hertzloop.studies.budget.result import BudgetResult
    from hertzloop.studies.cases.axis import DesignError
    from hertzloop.studies.cases.workers import WorkersLost
    from hertzloop.studies.margin.margin import MarginResult
    from hertzloop.studies.sweep.request import SweepRequest
    from hertzloop.studies.tune.request import TuneRequest
    from hertzloop.studies.tune.result import TuneResult
    from hertzloop.views.metrics_table import Comparison

__all__ = [
    "BudgetRequest",
    "BudgetResult",
    "BusError",
    "Comparison",
    "DesignError",
    "FitError",
    "FitResult",
    "Impact",
    "ImpactNoise",
    "MarginResult",
    "OptionError",
    "Record",
    "RecordError",
    "RecordingError",
    "Run",
    "RunFailed",
    "RunMetrics",
    "Scene",
    "SceneError",
    "SpanMetrics",
    "Stepper",
    "StreamFault",
    "SweepRequest",
    "TuneRequest",
    "TuneResult",
    "WorkersLost",
    "budget",
    "compare",
    "fit",
    "linear",
    "load",
    "margin",
    "modes",
    "read",
    "read_record",
    "read_records",
    "run",
    "scene_names",
    "simulate",
    "sweep",
    "tune",
    "vary",
]

# Names that are loaded at their first use, since a script that only simulates needs none of them.
_NAMES_BY_MODULE = {
    "views.metrics_table": ("Comparison",),
    "results.span_metrics": ("RunMetrics", "SpanMetrics"),
    "bus.port": ("BusError",),
    "bus.streams": ("StreamFault",),
    "api.stepper": ("Stepper",),
    "loop.run_options": ("OptionError",),
    "processes.launcher": ("RunFailed",),
    "recordings.writer": ("RecordingError",),
    "fitting.errors": ("FitError", "RecordError"),
    "fitting.fit.results": ("FitResult",),
    "fitting.records.record": ("Record",),
    "studies.budget.request": ("BudgetRequest",),
    "studies.budget.result": ("BudgetResult",),
    "studies.cases.axis": ("DesignError",),
    "studies.cases.workers": ("WorkersLost",),
    "studies.margin.margin": ("MarginResult",),
    "studies.sweep.request": ("SweepRequest",),
    "studies.tune.request": ("TuneRequest",),
    "studies.tune.result": ("TuneResult",),
}
_MODULES = {name: module for module, names in _NAMES_BY_MODULE.items() for name in names}


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return getattr(import_module(f"hertzloop.{_MODULES[name]}"), name)
    raise AttributeError(f"module '{__name__}' has no attribute '{name}'")
