"""The processes of a run: launcher, roles, fork server, signals, real-time profile."""
