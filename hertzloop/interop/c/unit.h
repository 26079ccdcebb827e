/* An exported plant as a co-simulation unit, as both versions of FMI see it. Statuses are numbered
   as theirs; what is wrong is said through `log` once. */

#ifndef HERTZLOOP_UNIT_H
#define HERTZLOOP_UNIT_H

#include "hertzloop_plant.h"
#include "variables.h" /* generated: the value references V_... */

enum { UNIT_OK = 0, UNIT_DISCARD = 2, UNIT_ERROR = 3 };
typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } unit_phase;

typedef struct unit unit;
typedef void unit_log(const unit *u, int status, const char *sentence);

typedef struct {
    unit_phase phase;
    int changed; /* a parameter, since the plant was last put to its start */
    double command_n, drop_height_m, start_s;
    int64_t seed;
} unit_known;

struct unit {
    hertzloop_plant *plant;
    unit_known known;
    int balanced; /* whether `energies` are those of the present step */
    hertzloop_energies energies;
    unit_log *log;
    void *environment, *logger; /* of the master */
    char name[128];
};

/* A unit, or NULL after saying why; `given` is the master's token. */
unit *unit_new(const char *name, const char *given, unit_log *log, void *environment, void *logger);
void unit_free(unit *u);

int unit_get_real(unit *u, unsigned reference, double *value);
int unit_get_integer(unit *u, unsigned reference, int64_t *value);
int unit_set_real(unit *u, unsigned reference, double value);
int unit_set_integer(unit *u, unsigned reference, int64_t value);

/* From one phase to the next; `call` is the function's name. */
int unit_turn(unit *u, const char *call, unit_phase from, unit_phase to);
int unit_reset(unit *u);
int unit_step(unit *u, double now_s, double step_s);
double unit_time_s(const unit *u);

/* States are blocks of `unit_state_bytes`; *state is used, or new memory if NULL. */
size_t unit_state_bytes(void);
int unit_get_state(unit *u, void **state);
int unit_set_state(unit *u, const void *state);
void unit_free_state(void **state);
int unit_write_state(unit *u, const void *state, void *bytes, size_t size);
int unit_read_state(unit *u, const void *bytes, size_t size, void **state);

int unit_refuse(unit *u, const char *call); /* a function that this unit does not have */
int unit_wrong(const unit *u, int status, const char *sentence, ...)
    __attribute__((format(printf, 3, 4)));

#endif
