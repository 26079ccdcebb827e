"""The series of the functions phi_k near zero, compiled."""

from jit import kernel
from jit.by_type import fused

_BLOCK = 256  # numbers that are followed together, in the processor's nearest memory


@kernel(borrowed=True)
def series(x_re, x_im, terms, re, im):
    """Sum of terms[i] x^i by Horner's rule for complex x, shape (numbers,), into `re` and `im`;
    products are rounded as NumPy rounds those of complex numbers."""
    for first in range(0, re.size, _BLOCK):
        end = min(first + _BLOCK, re.size)
        # Parts, whose indices need no second look: that is what lets vectors be formed.
        a, b, u, v = x_re[first:end], x_im[first:end], re[first:end], im[first:end]
        u[:] = terms[-1]
        v[:] = 0.0
        for at in range(terms.size - 2, -1, -1):
            term = terms[at]
            for i in range(u.size):
                across, along = -(v[i] * b[i]), v[i] * a[i]
                v[i] = fused(u[i], b[i], along)
                u[i] = fused(u[i], a[i], across) + term
