"""Imported before any test module."""

# Decides where compiled kernels are cached. It has to come before numba, which the parts
# import and which reads the folder once: without it a kernel could keep an old callee.
import hertzloop  # noqa: F401, I001
from hypothesis import settings

# The first call of a kernel may compile it: no example has to meet a time.
settings.register_profile("no clock", deadline=None)
settings.load_profile("no clock")
