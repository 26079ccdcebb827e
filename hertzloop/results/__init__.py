"""Metrics of a run as numbers: functions of setup and samples. `hertzloop.views` shows them."""
