/* The random numbers of a run: NumPy's Philox, keyed by seed and stream. */

#include <stdint.h>

/* The first number in [0, 1) of a stream. */
double hertzloop_uniform(int64_t seed, int64_t stream);

/* The first `count` normal numbers of a stream, times `rms`. */
void hertzloop_normal(int64_t seed, int64_t stream, double rms, double *values, int64_t count);
