"""Fit scene keys to measured records: estimates with 95 % intervals, and verdicts.

`fit.py` reads as the whole fit. These are its steps and their files, in order:

- The keys to find: free_keys, free_key_option (reads --free), hit_speeds (one key for each hit),
  key_scope.
- Each record made ready, as a channel: channel, channel_preparation, noise, sample_selection,
  alignment, controlled_records (records under a law).
- The simulation: impact_simulator, loop_simulator (under a law), simulators (one for each record),
  simulated_impact. What a sensor shows of it: measuring_chain, observed_signal.
- The least-squares problem: problem_preparation, parameters, priors, problem, finite_difference,
  iterate, simulation_counter.
- Its minimum: minimise, global_search, phase_search, discrete_key, outliers.
- The discrepancy of an inexact model: solution, discrepancy, discrepancy_estimate.
- Intervals of the keys: key_uncertainty, converter_draws, key_combinations, intervals.
- The verdict on the model: assessment, residual_tests, hold_out, verdicts.
- The result: results, residuals, summary, measure_next.
- Its views: fit_text, fit_json, fitted_scene, fit_page, fit_replay.

`check.py` says what records will tell before there is a fit, also of a supposed one
(expected_record). `file_description.py` describes a file of records without a scene.
"""
