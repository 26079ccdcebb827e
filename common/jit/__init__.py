"""Compiled kernels: how one is spelled, and where its machine code is kept."""

from hertzloop.common.jit.decorator import kernel

__all__ = ["kernel"]
