/* A law as a shared library for hertzloop.

   Start:  hertzloop law new mine.c     writes a law, and this header beside it
   Build:  cc -O2 -fPIC -shared -ffp-contract=off mine.c -o mine.so -lm
   Use:    controller.law = "mine.so"

   Without -ffp-contract=off the compiler may join a multiplication and an addition, and the bits
   differ from those of the same law in Python.

   A law turns samples into the force that the actuator commands. The library exports

     HERTZLOOP_LAW("contact_force", sizeof(struct parameters), sizeof(struct state))
     const struct hertzloop_key hertzloop_keys[] = {{"kappa", "1", "share", 0.8, -1, 1}, {0}};
     double hertzloop_command(const void *p, void *s, const double *samples, int64_t i);

   `p` begins with struct hertzloop_about, then comes one double for each key, in order; what lies
   behind them is for hertzloop_prepare. `s` is 0 at the start of a run and begins with struct
   hertzloop_mode. `samples` are all samples so far, samples[i] the new one. A law has no other
   memory than `s`: many runs call it, also at the same time. */
#ifndef HERTZLOOP_LAW_H
#define HERTZLOOP_LAW_H
#include <stdint.h>

#define HERTZLOOP_ABI 1

/* What is known of a run; SI units. */
struct hertzloop_about {
  double sample_s;         /* from one sample to the next */
  double loop_delay_s;     /* from a sample to the step on which its force acts */
  double stiffness;        /* of the contact, N/m^1.5 */
  double sphere_mass_kg;
  double impact_speed_m_s;
  double impedance_n_s_m;  /* of the plate at the contact point, as if infinite */
  double converter_step;   /* of the samples; 0 if they are not quantised */
  double limit_n;          /* the actuator's largest force; inf without */
};

/* A key of the law in [controller] of a scene; the last one has no name. */
struct hertzloop_key {
  const char *name, *unit, *description;
  double initial, least, most;
};

/* First words of every state. Events tell of the mode; delay (samples) is for laws that latch one. */
enum { HERTZLOOP_IDLE, HERTZLOOP_WATCHING, HERTZLOOP_ACTING, HERTZLOOP_SPENT };
struct hertzloop_mode {
  int64_t mode, delay;
};

struct hertzloop_description {
  int64_t abi;
  const char *senses; /* "xi", "v_p", "acceleration", "contact_force" or "any" */
  int64_t parameters_bytes, state_bytes; /* multiples of 8 */
};

#define HERTZLOOP_LAW(senses, parameters_bytes, state_bytes) \
  const struct hertzloop_description hertzloop_law = {       \
      HERTZLOOP_ABI, senses, parameters_bytes, state_bytes};

extern const struct hertzloop_description hertzloop_law;
extern const struct hertzloop_key hertzloop_keys[];

/* Force of sample i, N; a finite number. */
double hertzloop_command(const void *p, void *s, const double *samples, int64_t i);

/* If the law can: fills what lies in `p` behind the keys, once before a run. */
void hertzloop_prepare(void *p);
/* If the law can: how many commands after sample i no longer depend on samples to come ... */
int64_t hertzloop_known_ahead(const void *p, const void *s, const double *samples, int64_t i);
/* ... and the command of one of them, j > i. */
double hertzloop_command_ahead(const void *p, const void *s, const double *samples, int64_t i,
                               int64_t j);
/* If the law can: zero commands are certain while samples stay above this; inf for no promise. */
double hertzloop_trigger_level(const void *p, const void *s);
#endif
