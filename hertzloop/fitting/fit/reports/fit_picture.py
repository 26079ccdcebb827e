"""One picture of a fit: measured over simulated values of every record, and the residuals."""

from pathlib import Path

from hertzloop.fitting.fit.results import FitResult
from hertzloop.fitting.records.quantities import QUANTITIES
from hertzloop.studies.pages import pictures


def write_picture(result: FitResult, path: Path) -> None:
    """Draw the records of a fit to a file. Raises NotWritten."""
    rows = list(zip(result.records, result.nuisances, result.curves, strict=True))
    sheet, axes = pictures.sheet(len(rows), 2, width=10.0, height=2.6)
    for (left, right), (record, nuisance, curve) in zip(axes, rows, strict=True):
        time_us, used = 1e6 * curve["time_s"], curve["used"]
        residual = (curve["measured"] - curve["simulated"]) / nuisance.noise_rms
        left.plot(time_us[used], curve["measured"][used], ".", markersize=3, label="measured")
        left.plot(time_us, curve["simulated"], label="simulated")
        left.set(
            title=record.name, ylabel=f"{record.quantity} ({QUANTITIES[record.quantity].unit})"
        )
        left.legend()
        right.axhspan(-2.0, 2.0, color="#dfe4ec", label="twice the noise")
        right.plot(time_us[used], residual[used], ".", markersize=3, label="residual")
        right.set(ylabel="residual over noise")
        right.legend()
        for ax in (left, right):
            ax.set(xlabel="time after the first touch (us)")
    pictures.save(sheet, path)
