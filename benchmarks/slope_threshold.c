/* The shipped law slope_threshold in C: two-point slope, no lead. See controller/laws. */
#include "hertzloop_law.h"

#include <math.h>

struct parameters {
  struct hertzloop_about about;
  double kappa, v_thr_m_s;
};

struct state {
  struct hertzloop_mode law;
  int64_t contact_start, in_contact;
};

HERTZLOOP_LAW("xi", sizeof(struct parameters), sizeof(struct state))

const struct hertzloop_key hertzloop_keys[] = {
    {"kappa", "1", "share of the contact force", 0.8, -100.0, 100.0},
    {"v_thr_m_s", "m/s", "slope that latches the delay", -0.25, -1e3, 1e3},
    {0},
};

static double hertz(const struct parameters *p, double xi) {
  double depth = -xi > 0.0 ? -xi : 0.0;
  return p->kappa * p->about.stiffness * depth * sqrt(depth);
}

double hertzloop_command(const void *parameters, void *state, const double *samples, int64_t i) {
  const struct parameters *p = parameters;
  struct state *s = state;
  int64_t in_contact = samples[i] <= 0.0;
  if (in_contact && !s->in_contact) s->contact_start = i;
  s->in_contact = in_contact;
  if (s->law.mode == HERTZLOOP_IDLE && in_contact) s->law.mode = HERTZLOOP_WATCHING;
  if (s->law.mode == HERTZLOOP_WATCHING) {
    if (!in_contact) {
      s->law.mode = HERTZLOOP_IDLE;
    } else if (i > 0 && (samples[i] - samples[i - 1]) / p->about.sample_s > p->v_thr_m_s) {
      s->law.mode = HERTZLOOP_ACTING;
      s->law.delay = i - s->contact_start;
    }
  }
  if (s->law.mode != HERTZLOOP_ACTING) return 0.0;
  double xi = samples[i - s->law.delay];
  if (xi > 0.0) {
    s->law.mode = in_contact ? HERTZLOOP_WATCHING : HERTZLOOP_IDLE;
    return 0.0;
  }
  return hertz(p, xi);
}

int64_t hertzloop_known_ahead(const void *p, const void *state, const double *samples, int64_t i) {
  const struct state *s = state;
  (void)p;
  if (s->law.mode != HERTZLOOP_ACTING) return 0;
  for (int64_t ahead = 1; ahead <= s->law.delay; ahead++)
    if (samples[i + ahead - s->law.delay] > 0.0) return ahead;
  return s->law.delay;
}

double hertzloop_command_ahead(const void *p, const void *state, const double *samples, int64_t i,
                               int64_t j) {
  const struct state *s = state;
  (void)i;
  double xi = samples[j - s->law.delay];
  return xi > 0.0 ? 0.0 : hertz(p, xi);
}

double hertzloop_quiet_level(const void *p, const void *state) {
  const struct state *s = state;
  (void)p;
  return s->law.mode == HERTZLOOP_IDLE ? 0.0 : INFINITY;
}
