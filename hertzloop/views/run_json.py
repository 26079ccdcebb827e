"""A run or a recording as plain data, which `--json` writes."""

from collections.abc import Iterable
from dataclasses import asdict, replace
from typing import Any

from hertzloop.results.assessed_run import RunReport
from hertzloop.results.effects import EffectState, Neglected
from hertzloop.results.inspection import Assessment, Inspected
from hertzloop.results.metric_rows import MetricRow
from hertzloop.results.metrics import Metrics
from hertzloop.results.recorded import Pacing
from hertzloop.views.details import facts_as_json, recorded_as_json
from hertzloop.views.effects import out_of_range
from hertzloop.views.report import streams_of
from hertzloop.views.verdict import verdict_sentences

_NO_METRICS: dict[str, Any] = {
    "impacts": [],
    "noise": [],
    "first_impact": None,
    "whole_run": None,
    "stability": None,
    "demand": None,
    "validity": [],
    "warnings": [],
    "push": None,
    "last_contact_ended": True,
    "predictability": None,
    "verdict": [],
    "rows": [],
}


def effects_as_json(neglected: Neglected) -> dict[str, Any]:
    """Return the neglected effects as plain data.

    `validity` has all effects with the fields of `ValidityCheck`; `warnings` has a sentence on each
    effect that is out of range.
    """
    checks = [asdict(check) for check in neglected.checks]
    warnings = [
        f"{check['name']}: {check['sentence']}"
        for check in checks
        if check["state"] == EffectState.OUT_OF_RANGE
    ]
    return {"validity": checks, "warnings": warnings}


def metrics_as_json(found: Metrics) -> dict[str, Any]:
    """Return the metrics of a run as plain data.

    Keys are the fields of `Metrics`, with `validity` and `warnings` of `effects_as_json` in place
    of the neglected effects.
    """
    data = asdict(replace(found, neglected=Neglected(None)))
    del data["neglected"]
    return data | effects_as_json(found.neglected)


def pacing_as_json(found: Pacing | None) -> dict[str, Any] | None:
    """Return missed deadlines of a paced or repeated run, and response times of a paced one."""
    if found is None:
        return None
    data = asdict(found)
    clock, is_repeat = data.pop("clock"), data.pop("is_repeat")
    return data | (clock or {"pace": None, "is_repeat": is_repeat})


def rows_as_json(found: Iterable[MetricRow]) -> list[dict[str, Any]]:
    """Return the fields of each `MetricRow`, with the label that is printed."""
    return [{"label": row.label, **asdict(row)} for row in found]


def out_of_range_as_json(found: Assessment | None) -> list[str]:
    """Return the sentence on what is out of range, in a list; empty if nothing is."""
    return out_of_range(found.result.metrics.neglected.checks) if found else []


def assessment_as_json(found: Inspected) -> dict[str, Any]:
    """Return the metrics of a recorded run, their predictability and the verdict."""
    data = {**asdict(found.law), "pacing": pacing_as_json(found.pacing)}
    assessed = found.assessment
    if assessed is None:
        return data | _NO_METRICS
    return data | {
        **metrics_as_json(assessed.result.metrics),
        "predictability": asdict(assessed.predictability),
        "verdict": verdict_sentences(assessed),
        "rows": rows_as_json(assessed.rows),
    }


def run_as_json(report: RunReport) -> dict[str, Any]:
    """Return everything that `run --json` writes."""
    result = report.assessment.result
    data = {
        "out_of_range": out_of_range_as_json(report.assessment),
        **facts_as_json(report),
        "injected_j": result.injected_j,
        "expected_error": result.expected_error,
        "requested_accuracy": report.setup.run.accuracy,
        "uncontrolled": metrics_as_json(report.assessment.free or result.metrics),
        **assessment_as_json(report.inspected),
    }
    if report.options.repeat:
        data |= {"repeats": str(report.options.repeat), "differs": report.differs}
    if report.options.verify:
        found = report.verification
        data["verification"] = found and asdict(found) | {"largest": found.largest}
    return data


def inspection_as_json(found: Inspected) -> dict[str, Any]:
    """Return everything that `inspect --json` writes."""
    recording = found.recording
    return {
        "out_of_range": out_of_range_as_json(found.assessment),
        "complete": not found.problems,
        "problems": list(found.problems),
        **recorded_as_json(found),
        "streams": {
            name: {
                "messages": stream.messages,
                "samples": stream.samples,
                "fields": sorted(stream.arrays),
            }
            for name, stream in streams_of(recording)
        },
        "other_messages": recording.others,
        "unchecked_parts": recording.unchecked,
        "events": [
            {"time_s": e.time_ns * 1e-9, "name": e.name, "message": e.message}
            for e in recording.events
        ],
        "scene_toml": recording.scene_toml,
        **assessment_as_json(found),
    }
