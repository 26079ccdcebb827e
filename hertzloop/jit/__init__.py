"""Compiled kernels: how one is spelled, and where its machine code is kept."""

from hertzloop.jit.decorator import kernel

__all__ = ["kernel"]
