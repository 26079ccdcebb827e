"""The contents of a recording as plain data, which `inspect --json` writes."""

from dataclasses import asdict
from typing import Any

from hertzloop.results.inspection import Inspected, number_of
from hertzloop.views.inspection import streams_of
from hertzloop.views.run_json import (
    assessment_as_json,
    out_of_range_as_json,
)


def summary(found: Inspected) -> dict[str, Any]:
    """Return streams, counts, problems, scene, balance and metrics as plain data."""
    recording = found.recording
    data: dict[str, Any] = {
        "out_of_range": out_of_range_as_json(found.assessment),
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
    }
    if recording.balance is not None:
        data["residuals"] = {
            "momentum": recording.balance.momentum_residual,
            "energy": recording.balance.energy_residual,
        }
        data["yield"] = asdict(found.yielded) if found.yielded else None
    return data | assessment_as_json(found)
