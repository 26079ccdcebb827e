"""Fit scene keys to measured records: estimates with 95 % intervals, and verdicts.

`fit.py` reads as the whole fit. Its steps, in order:

- `free_keys`: the scene keys that a fit varies, and what each changes.
- `channel_preparation`: each `channel`, a record made ready; with its `noise`, its impact found by
  `alignment`, and its `discrepancy`.
- `impact_simulator`: a `simulated_impact` for other values of the keys, as its sensors show it.
- `problem_preparation`: the `problem`, which has `parameters`, residuals and their derivatives.
- `solution`: the minimum, without outliers. It calls `minimise` and `step_scan`.
- `intervals`: what the records know of the keys.
- `assessment`: what the fit leaves of the records, and whether the model fits.
- `results`: the result; `report` writes it as text, JSON, picture and scene.

`check.py` says what records will tell before there is a fit, also of a supposed one.
"""
