"""A measured record: values over time, with what is known of the measurement."""

from dataclasses import dataclass, field

import numpy as np

from hertzloop.fitting.records.errors import RecordError
from hertzloop.fitting.records.measurement import Measurement
from hertzloop.fitting.records.quantities import PLATE_QUANTITIES, known_quantity


@dataclass(frozen=True)
class Record:
    """A measured record: one channel of one impact.

    Args:
        name: name in messages.
        time_s: times by the record's clock, s, shape (samples,), rising; the zero is arbitrary.
        value: in the SI unit of the quantity, shape (samples,); nan where nothing is known.
        quantity: "contact_force", "actuator_force" (N), "v_p" (m/s), "acceleration" (m/s^2),
            "xi_p", "xi" or "xi_s" (m).
        measurement: the `[record]` table: filters, range, uncertainties.
        sha256: digest of the file, "" of a record from memory.
        notes: sentences on what is not used of the file.
        source: where times and values stand in the file, and in which units.
        hit: number of the hit, whose striker has a speed of its own; 0 of an only one.

    Raises:
        RecordError: the arrays cannot be a record.
    """

    name: str
    time_s: np.ndarray
    value: np.ndarray
    quantity: str
    measurement: Measurement = field(default_factory=Measurement)
    sha256: str = ""
    notes: tuple[str, ...] = ()
    source: str = ""
    hit: int = 0

    def __post_init__(self) -> None:
        known_quantity(self.quantity, self.name)
        if self.measurement.point_m is not None and self.quantity not in PLATE_QUANTITIES:
            raise RecordError(
                f"record.point_m = {list(self.measurement.point_m)}: a {self.quantity} has no "
                f"measuring point in {self.name}. Remove the key."
            )
        if len(self.time_s) != len(self.value) or np.ndim(self.value) != 1:
            raise RecordError(
                f"{self.name}: has {len(self.time_s)} times and values of shape "
                f"{np.shape(self.value)}. Give one value for each time."
            )
        if len(self.value) < FEWEST_SAMPLES:
            raise RecordError(
                f"{self.name}: has {len(self.value)} samples. Give at least {FEWEST_SAMPLES}, with "
                "some before the impact."
            )
        rises = self.time_s[1:] > self.time_s[:-1]
        if not np.all(rises):
            at = int(np.argmin(rises))
            raise RecordError(
                f"{self.name}: its times do not rise from sample to sample: sample {at + 2} at "
                f"{self.time_s[at + 1]:.9g} s follows sample {at + 1} at {self.time_s[at]:.9g} s. "
                "Give one impact in the order of time, and write times with enough digits. Or "
                "leave time_s out and give record.rate_hz."
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


FEWEST_SAMPLES = 8  # samples of a record
