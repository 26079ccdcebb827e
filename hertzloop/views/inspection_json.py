"""The contents of a recording as plain data, which `inspect --json` writes."""

from dataclasses import asdict
from typing import Any

from hertzloop.results.inspection import Inspected, number_of
from hertzloop.views.inspection import streams_of
from hertzloop.views.run_json import (
    metrics_as_json,
    out_of_range_as_json,
    pacing_as_json,
    predictability_as_json,
    rows_as_json,
)
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
}


def summary(found: Inspected) -> dict[str, Any]:
    """Return streams, counts, problems, scene, balance and metrics as plain data."""
    recording, assessed = found.recording, found.assessment
    data: dict[str, Any] = {
        "out_of_range": out_of_range_as_json(assessed),
        "file": str(recording.path),
        "complete": not found.problems,
        "problems": list(found.problems),
        "scene": recording.metadata.get("scene", ""),
        "seed": found.seed,
        "note": recording.note,
        "steps": number_of(recording, "steps"),
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
        **asdict(found.law),
    }
    if recording.balance is not None:
        data["residuals"] = {
            "momentum": recording.balance.momentum_residual,
            "energy": recording.balance.energy_residual,
        }
        data["yield"] = asdict(found.yielded) if found.yielded else None
    data["pacing"] = pacing_as_json(found.pacing)
    if assessed is None:
        return data | _NO_METRICS | {"verdict": [], "rows": []}
    return data | {
        **metrics_as_json(assessed.result.metrics),
        "predictability": predictability_as_json(assessed.predictability),
        "verdict": verdict_sentences(assessed),
        "rows": rows_as_json(assessed.rows),
    }
