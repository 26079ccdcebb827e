"""A fingerprint of samples: 128 bits that chance does not repeat; no protection from intent."""

import numpy as np

from hertzloop.common.jit import kernel

_FOLD, _SHIFT = np.uint64(0x9E3779B97F4A7C15), np.uint64(29)


@kernel(inline=True)
def _fold(state, word):
    """Mix a word of 64 bits into a state of 64 bits, one to one."""
    mixed = (state ^ word) * _FOLD
    return mixed ^ (mixed >> _SHIFT)


@kernel(inline=True)
def _fold_all(words, lanes):
    """Mix words into four lanes in turn, which the processor follows beside each other."""
    a, b, c, d = lanes
    whole = words.size - words.size % 4
    for i in range(0, whole, 4):
        a, b = _fold(a, words[i]), _fold(b, words[i + 1])
        c, d = _fold(c, words[i + 2]), _fold(d, words[i + 3])
    for i in range(whole, words.size):
        a = _fold(a, words[i])
    return _fold(a, np.uint64(words.size)), b, c, d


@kernel
def fingerprint(truth, samples):
    """Two words of 64 bits that tell truth, shape (columns, steps), and samples from others; both
    are arrays of words of 64 bits."""
    lanes = (np.uint64(1), np.uint64(2), np.uint64(3), np.uint64(4))
    for row in truth:
        lanes = _fold_all(row, lanes)
    a, b, c, d = _fold_all(samples, lanes)
    return _fold(_fold(a, b), _fold(c, d)), _fold(_fold(b, c), _fold(d, a))
