/* low_passed.py in C: the same bits.

   cc -O2 -fPIC -shared -ffp-contract=off low_passed.c -o low_passed.so -lm
   hertzloop run --set controller.law=low_passed.so --set controller.full_scale_n=20 */
#include "hertzloop_law.h"

#include <math.h>

struct parameters {
  struct hertzloop_about about;
  double kappa, corner_hz; /* the keys, in their order */
  double share;            /* from here on: filled by hertzloop_prepare */
};

struct state {
  struct hertzloop_mode law;
  double filtered_n;
};

HERTZLOOP_LAW("contact_force", sizeof(struct parameters), sizeof(struct state))

const struct hertzloop_key hertzloop_keys[] = {
    {"kappa", "1", "share of the contact force", 0.8, -100.0, 100.0},
    {"corner_hz", "Hz", "corner of the low-pass", 20e3, 1.0, 1e6},
    {0},
};

void hertzloop_prepare(void *parameters) {
  struct parameters *p = parameters;
  p->share = 1.0 - exp(-2.0 * 3.141592653589793 * p->corner_hz * p->about.sample_s);
}

double hertzloop_command(const void *parameters, void *state, const double *samples, int64_t i) {
  const struct parameters *p = parameters;
  struct state *s = state;
  s->filtered_n += p->share * (p->kappa * samples[i] - s->filtered_n);
  if (s->filtered_n > p->about.limit_n) s->filtered_n = p->about.limit_n;
  if (s->filtered_n < -p->about.limit_n) s->filtered_n = -p->about.limit_n;
  if (s->filtered_n != 0.0) s->law.mode = HERTZLOOP_ACTING;
  return s->filtered_n;
}
