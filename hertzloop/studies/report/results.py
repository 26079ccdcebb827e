"""Pages of results: which results a path names, and the page of the study that wrote them."""

import os
from pathlib import Path

from hertzloop.studies.pages.html import ResultPage
from hertzloop.studies.sweep.page import sweep_page
from hertzloop.studies.tune.page import tune_page
from hertzloop.studies.tune.result import read_tuned


def results_in(path: Path) -> Path:
    """The results that a path names: itself, or the only ones in a folder. Raises ValueError."""
    if not os.path.isdir(path):
        return path
    found = sorted(
        [*path.glob("tune-*.json"), *path.glob("*.parquet")]
        + [p.with_suffix("") for p in path.glob("*.csv.json")]
    )
    if len(found) != 1:
        names = ", ".join(one.name for one in found[:5])
        raise ValueError(
            f"{path} holds no results of a sweep or a tuning"
            if not found
            else f"{path} holds {len(found)} results ({names}). Name one of them"
        )
    return found[0]


def page_of_results(path: Path) -> ResultPage:
    """The page of a sweep's .parquet or .csv, or of a tuning's .json or .csv.

    Raises ValueError if the file is none of these, SceneError if its scene cannot be read.
    """
    if path.name.startswith("tune-") and path.suffix in (".json", ".csv"):
        return tune_page(read_tuned(path.with_suffix(".json")))
    return sweep_page(path)
