"""Compiled kernels: how one is spelled, and where its machine code is kept."""

from jit.decorator import kernel

__all__ = ["kernel"]
