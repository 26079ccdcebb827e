"""A measured record: values over time, with what is known of the measurement."""

from collections.abc import Mapping
from dataclasses import InitVar, dataclass, field
from typing import Any

import numpy as np

from hertzloop.fitting.errors import RecordError
from hertzloop.fitting.records.measurement import Measurement, parse_record_table
from hertzloop.fitting.records.quantities import PLATE_QUANTITIES, known_quantity

FEWEST_SAMPLES = 8  # samples of a record
_OF_FILES = ("column", "decimal", "rate_hz", "time_column", "time_unit", "unit")


@dataclass(eq=False)
class Record:
    """A measured record: one quantity of one impact.

    Args:
        name: name in messages.
        time_s: times by the record's clock, s, shape (samples,), rising; the zero is arbitrary.
        value: in the SI unit of the quantity, shape (samples,); nan where nothing is known.
        quantity: "contact_force", "actuator_force" (N), "v_p" (m/s), "acceleration" (m/s^2),
            "xi_p", "xi" or "xi_s" (m).
        table: keys of a `[record]` table, such as {"low_pass_hz": 1e4}; a range is in the SI unit.
        measurement: the same, checked already.
        clock: a name that records of one impact share if one clock sampled them.
        sha256: digest of the file, "" of a record from memory.
        notes: sentences on what is not used of the file.
        source: where times and values stand in the file, and in which units.

    Raises:
        RecordError: the arrays cannot be a record, or a key is wrong.
    """

    name: str
    time_s: np.ndarray
    value: np.ndarray
    quantity: str
    table: InitVar[Mapping[str, Any] | None] = None
    measurement: Measurement = field(default_factory=Measurement)
    clock: str = ""
    sha256: str = ""
    notes: tuple[str, ...] = ()
    source: str = "from memory"

    def __post_init__(self, table: Mapping[str, Any] | None) -> None:
        known_quantity(self.quantity, self.name)
        if table:
            self.measurement = parse_record_table(table, self.name)
            if wrong := [key for key in _OF_FILES if key in table]:
                raise RecordError(
                    f"record.{wrong[0]}: describes a file, but {self.name} is made of arrays. "
                    "Give times in s and values in SI units, and remove the key."
                )
        if self.measurement.point_m is not None and self.quantity not in PLATE_QUANTITIES:
            raise RecordError(
                f"record.point_m = {list(self.measurement.point_m)}: a {self.quantity} has no "
                f"measuring point in {self.name}. Remove the key."
            )
        self.time_s = np.asarray(self.time_s, float)
        self.value = np.asarray(self.value, float)
        if self.time_s.shape != self.value.shape or self.value.ndim != 1:
            raise RecordError(
                f"{self.name}: has times of shape {self.time_s.shape} and values of shape "
                f"{self.value.shape}. Give one value for each time."
            )
        known = np.isfinite(self.value)
        if np.count_nonzero(known) < max(FEWEST_SAMPLES, 0.5 * len(self.value)):
            raise RecordError(
                f"{self.name}: has {np.count_nonzero(known)} samples that are numbers, of "
                f"{len(self.value)}. Give at least {FEWEST_SAMPLES} and half of all, with some "
                "before the impact."
            )
        rises = self.time_s[1:] > self.time_s[:-1]
        if not np.all(rises):
            at = int(np.argmin(rises))
            raise RecordError(
                f"{self.name}: its times do not rise from sample to sample: sample {at + 2} at "
                f"{self.time_s[at + 1]:.9g} s follows sample {at + 1} at {self.time_s[at]:.9g} s. "
                "Give one impact in the order of time, and write times with enough digits. Or "
                "remove the column of times and give record.rate_hz."
            )

        largest_s = float(np.max(np.abs(self.time_s)))
        if np.spacing(largest_s) > 0.01 * self.interval_s:
            raise RecordError(
                f"{self.name}: its times are so large that a double holds them to "
                f"{np.spacing(largest_s):.2g} s only. Subtract the time of the first sample."
            )

    def repeats(self, other: "Record") -> bool:
        """Whether another record holds the same samples of a file of the same bytes."""
        return (
            self.sha256 == other.sha256 != ""
            and self.quantity == other.quantity
            and np.array_equal(self.value, other.value, equal_nan=True)
        )

    @property
    def interval_s(self) -> float:
        """Median time between two samples, s."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def uniform(self) -> bool:
        """Whether samples have one distance, to a hundredth of it."""
        steps = np.diff(self.time_s)
        return bool(np.max(np.abs(steps - self.interval_s)) < 1e-2 * self.interval_s)
