"""Fit scene keys to measured records: estimates with 95 % intervals, and verdicts.

`fit.py` reads as the whole fit; a folder for each of its steps, in order:

- `keys`: the scene keys that a fit varies, and what each changes.
- `channels`: each record made ready, with its noise, its impact and its discrepancy.
- `simulation`: the impact for other values of the keys, and what a sensor shows of it.
- `problem`: parameters, priors, residuals and their derivatives.
- `solver`: the minimum, without outliers; `solution.py` calls the others.
- `uncertainty`: the intervals of the keys.
- `assessment`: whether the model fits, and what the fit leaves of the records.
- `reports`: the result as text, JSON, page, replay and scene.

`hold_out.py` compares records that the fit has not seen. `check.py` says what records will tell
before there is a fit, also of a supposed one (`expected_record.py`).
"""
