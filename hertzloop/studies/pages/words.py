"""What metrics, keys and cases are called in print: words with units, and commands."""

import csv
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from hertzloop.common.atomic_files import whole_file
from hertzloop.common.readable import argument
from hertzloop.results.cases import CASE_FACTS
from hertzloop.scene.fields import unit_of
from hertzloop.scene.toml import toml_text

METRICS = {name: f"{row.label} ({row.unit})" for name, row in CASE_FACTS.items() if row.unit}
AXES = {
    "sensors.bits": "bits of the sensor",
    "sensors.every_steps": "sampling period (steps)",
    "controller.kappa": "kappa",
    "controller.v_thr_m_s": "threshold v_thr (m/s)",
    "controller.jitter_us": "largest jitter (us)",
    "controller.drop_out_probability": "share of commands lost",
    "controller.latency_us": "latency (us)",
}


def against_none(metric: str) -> str:
    """A metric of a case, as an axis of its own: most are against no control."""
    words = METRICS.get(metric, metric.replace("_", " "))
    if metric in CASE_FACTS and CASE_FACTS[metric].unit not in ("dB", "%"):
        return words
    name, _, unit = words.partition(" (")
    return f"{name} against no control ({unit}" if unit else name


def key_words(key: str) -> str:
    """A scene key as an axis: words with a unit."""
    if key in AXES:
        return AXES[key]
    name, unit = unit_of(key)
    name = name.partition(".")[2].replace("_", " ") or name
    return f"{name} ({unit})" if unit else name


def short(value: Any) -> str:
    """A value of a key in four digits."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def law(name: str) -> str:
    """A law's name in words."""
    return name.replace("_", " ")


def run_command(
    scene: str, case: Mapping[str, Any], settings: Sequence[str] = (), seed: int | None = None
) -> str:
    """Return the command that runs a case.

    Args:
        scene: Name or file of the scene.
        case: Values of scene keys.
        settings: Other changes of keys, as of --set; the case replaces those of its keys.
        seed: Random seed, unless the case has its own; None: that of the scene.
    """
    others = [text for text in settings if text.partition("=")[0].strip() not in case]
    changes = [*others, *(f"{key}={toml_text(value)}" for key, value in case.items())]
    words = [word for change in changes for word in ("--set", change)]
    seeded = [] if seed is None or "run.seed" in case else ["--seed", str(seed)]
    return shlex.join(["hertzloop", "run", argument(scene), *words, *seeded])


def write_rows(path: Path, header: Sequence[str], rows: Iterable[Sequence[Any]]) -> None:
    """One line a row under a header. Raises NotWritten."""
    with whole_file(path) as unfinished, unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)
