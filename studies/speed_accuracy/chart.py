"""Drawing of the speed-accuracy chart: two families of schemes, one column a scene."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from studies import pictures

# The default scheme is in both rows, as series 0.
_FAMILIES = {
    "textbook and second-order schemes": (
        "modal", "discrete_gradient", "quadratised", "convolution", "verlet", "rk4", "newmark",
        "hht",
    ),
    "high-order and adaptive schemes": (
        "modal", "collocation-s1", "collocation-s2", "collocation-s3", "dop853 compiled", "dop853",
        "cvode", "lsoda",
    ),
}  # fmt: skip


def draw(path: Path, names: Sequence[str], points: Sequence[Any]) -> None:
    """Error of the gap against CPU time; a row a family, a column a scene. Schemes that
    were left out are below, with the reason."""
    figure, axes = pictures.sheet(len(_FAMILIES), len(names), 4.6 * len(names) + 2.0, 3.9)
    for row, (family, schemes) in zip(axes, _FAMILIES.items(), strict=True):
        for axis, name in zip(row, names, strict=True):
            for i, scheme in enumerate(schemes):
                mine = [p for p in points if (p.scene, p.scheme, p.status) == (name, scheme, "ok")]
                axis.loglog(
                    [p.cpu_s_per_ms for p in mine], [p.error for p in mine],
                    label=scheme, **pictures.look(i, True),
                )  # fmt: skip
            axis.set(title=f"{name}: {family}", xlabel="CPU time (s per simulated ms)")
            axis.set_ylabel("error of the gap")
            axis.set_ylim(1e-9, 1.0)
            axis.title.set_fontsize(9)
        lines, labels = row[0].get_legend_handles_labels()
        row[-1].legend(lines, labels, loc="upper left", bbox_to_anchor=(1.01, 1.0))
    words = [f"{p.scene}, {p.scheme}: {p.status}" for p in points if p.status.startswith("omitted")]
    if "radau" in {p.scheme for p in points if p.status == "ok"}:
        words.append("radau: not drawn where it ends, beside lsoda (see the CSV)")
    figure.supxlabel("\n".join(words), fontsize=7)
    pictures.save(figure, path)
