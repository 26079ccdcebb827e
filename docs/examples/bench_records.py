"""Make the synthetic records of the tutorial: `python docs/examples/bench_records.py`.

They are written beside this file: two records to fit and one to hold out, of a rig whose true
values are those of TRUE. A plate of unknown alloy yields at 1.5 GPa, not at 1.05 GPa.
"""

from pathlib import Path

import numpy as np

from benchmarks.synthetic_records import Spoilt, measured, truth
from hertzloop.scene.setup import load

EXAMPLES = Path(__file__).parent
SOURCE = "`docs/examples/bench_records.py`"
TRUE = {
    "contact.limiting_pressure_pa": 1.5e9,
    "plate.thickness_m": 3.04e-3,
    "plate.loss_factor": 2e-3,
}
_RECORDS = (
    # Name, quantity, duration (s), rate (Hz), quiet (s), drop height (m), seed.
    ("bench-force", "contact_force", 80e-6, 2e6, 200e-6, 0.05, 11),
    ("bench-velocity", "v_p", 3e-3, 4e5, 800e-6, 0.05, 12),
    ("bench-force-higher", "contact_force", 80e-6, 2e6, 200e-6, 0.08, 13),
)


def main() -> None:
    """Write the records and their tables."""
    rig = load(str(EXAMPLES / "bench.toml")).without_control().vary(TRUE)
    for name, quantity, duration_s, rate_hz, quiet_s, height_m, seed in _RECORDS:
        one = rig.vary({"sphere.drop_height_m": height_m})
        record = measured(
            truth(one, quantity, duration_s),
            Spoilt(0.004, 1.012, 0.01, 15.0),
            seed,
            rate_hz=rate_hz,
            quiet_s=quiet_s,
        )
        column = {"contact_force": "contact_force_n", "v_p": "v_p_m_s"}[quantity]
        table = [
            "[record]",
            "sensitivity_uncertainty = 0.02",
            "clock_tolerance_ppm = 25",
        ]
        if height_m != rig.mechanics.sphere.drop_height_m:
            table.append(f'set = {{"sphere.drop_height_m" = {height_m}}}')
        rows = np.stack([record.time_s, record.value], axis=1)
        (EXAMPLES / f"{name}.toml").write_text("\n".join(table) + "\n", encoding="utf-8")
        with (EXAMPLES / f"{name}.csv").open("w", encoding="utf-8") as file:
            file.write(f"# SYNTHETIC: made by {SOURCE}, not measured.\ntime_s,{column}\n")
            np.savetxt(file, rows, delimiter=",", fmt=["%.8f", "%.6g"])


if __name__ == "__main__":
    main()
