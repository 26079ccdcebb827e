"""What a tuning found, as a file that says how it was found."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from studies.sweeps.phases import Spread


@dataclass(frozen=True)
class Found:
    """A setting and what it gives: values by key, objectives by name (the worst of the scenes),
    and their `spreads` over the touch phase (of the scene with the worst mean), where known."""

    values: dict[str, Any]
    figures: dict[str, float]
    spreads: dict[str, Spread] = field(default_factory=dict)


@dataclass(frozen=True)
class Tuned:
    """Settings that no other beats, the published one, and what was asked for: scenes as TOML,
    figures, the span, limits, the command that finds them again."""

    scenes: Sequence[str]
    objectives: Sequence[str]
    span: str
    at_most: Mapping[str, float]
    front: list[Found]
    published: Found
    verdict: Sequence[str]
    failed: int
    command: str
    versions: str


def write_tuned(path: Path, tuned: Tuned) -> None:
    """Write a JSON file. Raises OSError."""
    data = asdict(tuned)
    for found in (*data["front"], data["published"]):
        for spread in found["spreads"].values():  # JSON knows no nan
            spread.update({k: None if math.isnan(v) else v for k, v in spread.items()})
    text = json.dumps({"tuned": data}, indent=2, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8")


def read_tuned(path: Path) -> Tuned:
    """Raises ValueError for another kind of file."""
    try:
        data = json.loads(path.read_text(encoding="utf-8"))["tuned"]
        front = [_found(one) for one in data.pop("front")]
        return Tuned(front=front, published=_found(data.pop("published")), **data)
    except FileNotFoundError as error:
        raise ValueError(f"there are no results {path}") from error
    except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(f"{path} holds no results of a tuning: {error}") from error


def _found(data: dict[str, Any]) -> Found:
    spreads = {
        name: Spread(**{k: math.nan if v is None else v for k, v in spread.items()})
        for name, spread in data["spreads"].items()
    }
    return Found(data["values"], data["figures"], spreads)
