"""Figures of a run as numbers: functions of setup and samples. Nothing here is written in words."""
