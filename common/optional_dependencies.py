"""Packages that only some commands need: which extra brings them."""

import importlib.util

EXTRAS = {
    "matplotlib": "charts",
    "jinja2": "charts",
    "xarray": "python",
    "pymoo": "tune",
    "cryptography": "hosts",
    "fmpy": "interop",
    "distributed": "dask",
    "control": "control",
    "sdypy": "comparisons",
}


def need(*packages: str) -> None:
    """Raise ModuleNotFoundError, which says how to install them, for all of these packages that are
    missing, not for the first."""
    missing = [package for package in packages if importlib.util.find_spec(package) is None]
    if missing:
        names = " ".join(missing)
        raise ModuleNotFoundError(sentence_on(names), name=names)


def sentence_on(missing: str | None) -> str | None:
    """How to install packages that could not be imported, apart by spaces; None if no extra brings
    one of them."""
    packages = [name.partition(".")[0] for name in (missing or "").split()]
    if not packages or not EXTRAS.keys() >= set(packages):
        return None
    extras = ",".join(dict.fromkeys(EXTRAS[package] for package in packages))
    are = "is" if len(packages) == 1 else "are"
    return (
        f"this needs {' and '.join(packages)}, which {are} not installed: "
        f"pip install 'hertzloop[{extras}]'"
    )
