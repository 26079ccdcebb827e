/* A plant of hertzloop as a C library: sphere, contact, plate, actuator and sensor, in steps of
   fixed length. SI units; forces are positive upwards, the gap is negative in contact.

   A plant's functions may be called from one thread at a time; plants know nothing of each other.
   Functions that return int return 0 (HERTZLOOP_OK), or what was wrong, with a sentence from
   hertzloop_plant_said(); then nothing has changed. */

#ifndef HERTZLOOP_PLANT_H
#define HERTZLOOP_PLANT_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define HERTZLOOP_API __attribute__((visibility("default")))

enum { HERTZLOOP_OK, HERTZLOOP_WRONG, HERTZLOOP_AT_END, HERTZLOOP_NO_MEMORY };

typedef struct hertzloop_plant hertzloop_plant;

typedef struct {
    const char *scene;      /* that the plant was made of */
    const char *processor;  /* that the code is for */
    const char *quantity;   /* that the sensor reads, with its unit */
    double step_s;          /* length of a step */
    int64_t every_steps;    /* steps from sample to sample */
    int64_t steps;          /* length of the run: the plant goes no further */
    double drop_height_m;   /* of the scene */
    int64_t seed;           /* of the scene */
    size_t state_bytes;     /* of hertzloop_plant_get_state */
} hertzloop_about;

typedef struct {
    int64_t step;               /* steps done */
    int64_t samples;            /* taken so far; the first one at step 0 */
    double sample;              /* the latest, as read, in units of its quantity */
    int64_t code;               /* its code of the converter; 0 of an ideal one */
    int64_t clipped;            /* whether it was out of the converter's range */
    double gap_m;               /* between sphere and plate, now */
    double sphere_height_m;
    double plate_deflection_m;  /* at the contact point */
    double plate_velocity_m_s;  /* there, now: no mean over the last step */
    double contact_force_n;     /* mean over the last step, on the sphere */
    double actuator_force_n;    /* mean over the last step, on the plate */
} hertzloop_values;

typedef struct {
    double kinetic_j;            /* of the sphere */
    double gravity_j;
    double modal_j;              /* in the plate */
    double contact_j;            /* stored in the contact */
    double injected_j;           /* by the actuator, so far */
    double modal_dissipated_j;   /* lost in the plate, so far */
    double contact_dissipated_j;
    double plastic_dissipated_j;
    double residual;             /* missing part of the energy balance, relative */
} hertzloop_energies;

/* What was exported. */
HERTZLOOP_API const hertzloop_about *hertzloop_plant_about(void);

/* Why this processor cannot run the code, in a sentence; NULL if it can. */
HERTZLOOP_API const char *hertzloop_plant_refused(void);

/* A plant at its start, as the scene says; NULL without memory or on a processor that is refused. */
HERTZLOOP_API hertzloop_plant *hertzloop_plant_new(void);
HERTZLOOP_API void hertzloop_plant_free(hertzloop_plant *plant);

/* Back to the start, with a drop height (1e-7 to 100 m; modes, damping and the converter's range
   stay those of the scene) and a seed (of the sensor's noise, and of a random touch phase). */
HERTZLOOP_API int hertzloop_plant_reset(hertzloop_plant *plant, double drop_height_m, int64_t seed);

/* Some steps under one commanded actuator force. HERTZLOOP_AT_END: beyond the length of the run. */
HERTZLOOP_API int hertzloop_plant_step(hertzloop_plant *plant, double command_n, int64_t steps);

HERTZLOOP_API void hertzloop_plant_values(const hertzloop_plant *plant, hertzloop_values *values);

/* The same of `count` plants, each under a command of its own, and what they show then. Returns how
   many went: fewer than `count` if that one has something to say. */
HERTZLOOP_API int64_t hertzloop_plant_step_all(hertzloop_plant *const *plants,
                                               const double *commands_n, int64_t count,
                                               int64_t steps, hertzloop_values *values);

/* Energies at the present step. This passes through all modes: not for every step. */
HERTZLOOP_API void hertzloop_plant_energies(hertzloop_plant *plant, hertzloop_energies *energies);

/* The whole state, `state_bytes` of it, to come back to; for this very library alone. */
HERTZLOOP_API void hertzloop_plant_get_state(const hertzloop_plant *plant, void *state);
HERTZLOOP_API int hertzloop_plant_set_state(hertzloop_plant *plant, const void *state);

/* What the last call that did not return 0 had to say. */
HERTZLOOP_API const char *hertzloop_plant_said(const hertzloop_plant *plant);

#ifdef __cplusplus
}
#endif
#endif
