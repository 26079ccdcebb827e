"""Modes of a simply supported plate by rising frequency, without a general sort.

They are taken in slices of the frequency, each small enough for the processor's nearest memory, and
a slice in bands. A plate has as many modes in every band: with a band for every mode or so, sorting
takes a time that grows as the modes do. Modes of equal frequency stay in the order of n, then m, as
a stable sort leaves them. Squared wave numbers along the sides, `along_x`, `along_y` (1/m^2), rise;
frequencies are in rad/s; `nexts`, the mode of every row that is next, and `starts`, where bands
start, are room; all arrays are the caller's.
"""

from hertzloop.common.jit import kernel


@kernel
def skip(along_x, along_y, speed, above, nexts):
    """Let every row begin above a frequency."""
    for j in range(along_y.size):
        i = 0
        while i < along_x.size and speed * (along_y[j] + along_x[i]) <= above:
            i += 1
        nexts[j] = i


@kernel(inline=True)
def count(along_x, along_y, speed, low, high, nexts, starts):
    """Count the modes of a slice; lets `starts` tell where those of every band start, and gives
    back the bands per rad/s and the number of modes."""
    bands = starts.size - 1
    scale = (bands - 1) / (high - low)
    for band in range(starts.size):
        starts[band] = 0
    for j in range(along_y.size):
        i = nexts[j]
        if i == 0 and speed * (along_y[j] + along_x[0]) > high:
            break  # so are all modes of the rows that follow
        while i < along_x.size:
            omega = speed * (along_y[j] + along_x[i])
            if omega > high:
                break
            starts[int((omega - low) * scale) + 1] += 1
            i += 1
    for band in range(bands):
        starts[band + 1] += starts[band]
    return scale, starts[bands]


@kernel(inline=True)
def top(above, up_to, piece, slices):
    """The upper end of a slice; of the last one to the bit."""
    return up_to if piece == slices else above + (up_to - above) * (piece / slices)


@kernel
def flexibilities(
    along_x, along_y, sin_x, sin_y, speed, above, up_to, slices, nexts, starts, omega, terms
):
    """(phi/w)^2 of all modes above a frequency and up to another, phi the product of both sines;
    how many there are. `omega` is room for one slice after the other."""
    skip(along_x, along_y, speed, above, nexts)
    done, high = 0, above
    for piece in range(1, slices + 1):
        low, high = high, top(above, up_to, piece, slices)
        scale, found = count(along_x, along_y, speed, low, high, nexts, starts)
        own_terms = terms[done:]
        for j in range(along_y.size):
            i = nexts[j]
            if i == 0 and speed * (along_y[j] + along_x[0]) > high:
                break
            while i < along_x.size:
                own = speed * (along_y[j] + along_x[i])
                if own > high:
                    break
                band = int((own - low) * scale)
                at = starts[band]
                starts[band] = at + 1
                share = sin_x[i] * sin_y[j] / own
                omega[at], own_terms[at] = own, share * share
                i += 1
            nexts[j] = i
        for first in range(1, found):
            own, term, at = omega[first], own_terms[first], first
            while at > 0 and omega[at - 1] > own:
                omega[at], own_terms[at] = omega[at - 1], own_terms[at - 1]
                at -= 1
            omega[at], own_terms[at] = own, term
        done += found
    return done
