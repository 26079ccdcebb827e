/* See unit.h. */

#include "unit.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const double OFF = 1e-3; /* of a step: how far from whole steps times may be */

int unit_wrong(const unit *u, int status, const char *sentence, ...) {
    char said[512];
    va_list numbers;
    va_start(numbers, sentence);
    vsnprintf(said, sizeof said, sentence, numbers);
    va_end(numbers);
    u->log(u, status, said);
    return status;
}

int unit_refuse(unit *u, const char *call) {
    return u ? unit_wrong(u, UNIT_ERROR, "this unit has no %s", call) : UNIT_ERROR;
}

static void at_start(unit *u) {
    const hertzloop_about *about = hertzloop_plant_about();
    u->known = (unit_known){.phase = INSTANTIATED, .changed = 1,
                            .drop_height_m = about->drop_height_m, .seed = about->seed};
    u->balanced = 0;
}

unit *unit_new(const char *name, const char *given, unit_log *log, void *environment,
               void *logger) {
    unit *u = calloc(1, sizeof *u);
    if (!u)
        return NULL;
    u->log = log;
    u->environment = environment;
    u->logger = logger;
    snprintf(u->name, sizeof u->name, "%s", name ? name : "");
    const char *refused = hertzloop_plant_refused();
    if (refused)
        unit_wrong(u, UNIT_ERROR, "%s", refused);
    else if (!given || strcmp(given, UNIT_TOKEN) != 0)
        unit_wrong(u, UNIT_ERROR, "the model description is of another unit: its token is %s, not %s",
                   given ? given : "missing", UNIT_TOKEN);
    else if (!(u->plant = hertzloop_plant_new()))
        unit_wrong(u, UNIT_ERROR, "there is no memory for the plant");
    if (!u->plant) {
        free(u);
        return NULL;
    }
    at_start(u);
    return u;
}

void unit_free(unit *u) {
    if (u)
        hertzloop_plant_free(u->plant);
    free(u);
}

/* Let changed parameters act. */
static int settled(unit *u) {
    if (!u->known.changed)
        return UNIT_OK;
    if (hertzloop_plant_reset(u->plant, u->known.drop_height_m, u->known.seed) != HERTZLOOP_OK)
        return unit_wrong(u, UNIT_ERROR, "%s", hertzloop_plant_said(u->plant));
    u->known.changed = u->balanced = 0;
    return UNIT_OK;
}

double unit_time_s(const unit *u) {
    hertzloop_values values;
    hertzloop_plant_values(u->plant, &values);
    return u->known.start_s + (double)values.step * hertzloop_plant_about()->step_s;
}

int unit_get_real(unit *u, unsigned reference, double *value) {
    hertzloop_values now;
    if (settled(u) != UNIT_OK)
        return UNIT_ERROR;
    hertzloop_plant_values(u->plant, &now);
    if (reference >= V_KINETIC && reference <= V_RESIDUAL) {
        if (!u->balanced)
            hertzloop_plant_energies(u->plant, &u->energies);
        u->balanced = 1;
        memcpy(value, (const char *)&u->energies + sizeof *value * (reference - V_KINETIC),
               sizeof *value);
        return UNIT_OK;
    }
    switch (reference) {
    case V_TIME: *value = unit_time_s(u); break;
    case V_COMMAND: *value = u->known.command_n; break;
    case V_DROP_HEIGHT: *value = u->known.drop_height_m; break;
    case V_SAMPLE: *value = now.sample; break;
    case V_GAP: *value = now.gap_m; break;
    case V_SPHERE_HEIGHT: *value = now.sphere_height_m; break;
    case V_PLATE_DEFLECTION: *value = now.plate_deflection_m; break;
    case V_PLATE_VELOCITY: *value = now.plate_velocity_m_s; break;
    case V_CONTACT_FORCE: *value = now.contact_force_n; break;
    case V_ACTUATOR_FORCE: *value = now.actuator_force_n; break;
    default: return unit_wrong(u, UNIT_ERROR, "there is no real variable %u", reference);
    }
    return UNIT_OK;
}

int unit_get_integer(unit *u, unsigned reference, int64_t *value) {
    hertzloop_values now;
    if (settled(u) != UNIT_OK)
        return UNIT_ERROR;
    hertzloop_plant_values(u->plant, &now);
    switch (reference) {
    case V_NOISE_SEED: *value = u->known.seed; break;
    case V_SAMPLE_CODE: *value = now.code; break;
    case V_SAMPLE_CLIPPED: *value = now.clipped; break;
    default: return unit_wrong(u, UNIT_ERROR, "there is no integer variable %u", reference);
    }
    return UNIT_OK;
}

static int parameter_allowed(unit *u, const char *name) {
    if (u->known.phase == INSTANTIATED || u->known.phase == INITIALISING)
        return UNIT_OK;
    return unit_wrong(u, UNIT_ERROR, "%s can be set before the run only; reset the unit first", name);
}

int unit_set_real(unit *u, unsigned reference, double value) {
    if (reference == V_COMMAND) {
        if (!isfinite(value))
            return unit_wrong(u, UNIT_ERROR, "force_command is %g; a force is a number", value);
        u->known.command_n = value;
        return UNIT_OK;
    }
    if (reference != V_DROP_HEIGHT)
        return unit_wrong(u, UNIT_ERROR, "the real variable %u cannot be set; force_command and "
                          "drop_height can", reference);
    if (parameter_allowed(u, "drop_height") != UNIT_OK)
        return UNIT_ERROR;
    if (!(value >= 1e-7 && value <= 100.0))
        return unit_wrong(u, UNIT_ERROR, "drop_height is %g m; 1e-7 to 100 is possible", value);
    u->known.drop_height_m = value;
    u->known.changed = 1;
    return UNIT_OK;
}

int unit_set_integer(unit *u, unsigned reference, int64_t value) {
    if (reference != V_NOISE_SEED)
        return unit_wrong(u, UNIT_ERROR, "the integer variable %u cannot be set; noise_seed can",
                          reference);
    if (parameter_allowed(u, "noise_seed") != UNIT_OK)
        return UNIT_ERROR;
    if (value < 0)
        return unit_wrong(u, UNIT_ERROR, "noise_seed is %lld; it is 0 or more", (long long)value);
    u->known.seed = value;
    u->known.changed = 1;
    return UNIT_OK;
}

int unit_turn(unit *u, const char *call, unit_phase from, unit_phase to) {
    static const char *const phases[] = {"instantiated", "initialising", "stepping", "terminated"};
    if (u->known.phase != from)
        return unit_wrong(u, UNIT_ERROR, "%s while the unit is %s; it has to be %s", call,
                          phases[u->known.phase], phases[from]);
    if (settled(u) != UNIT_OK)
        return UNIT_ERROR;
    u->known.phase = to;
    return UNIT_OK;
}

int unit_reset(unit *u) {
    at_start(u);
    return settled(u);
}

int unit_step(unit *u, double now_s, double step_s) {
    const hertzloop_about *about = hertzloop_plant_about();
    if (u->known.phase != STEPPING)
        return unit_wrong(u, UNIT_ERROR, "a step is asked for before initialisation is over, or after "
                          "the end");
    double there_s = unit_time_s(u);
    if (!(fabs(now_s - there_s) <= OFF * about->step_s))
        return unit_wrong(u, UNIT_ERROR, "a step from %.9g s is asked for; the unit is at %.9g s",
                          now_s, there_s);
    double steps = step_s / about->step_s, whole = round(steps);
    if (!(whole >= 1.0 && whole < 9e15 && fabs(steps - whole) <= OFF))
        return unit_wrong(u, UNIT_DISCARD, "a communication step of %.9g s is asked for; it has to be "
                          "a multiple of %.9g s", step_s, about->step_s);
    int status = hertzloop_plant_step(u->plant, u->known.command_n, (int64_t)whole);
    if (status != HERTZLOOP_OK)
        return unit_wrong(u, status == HERTZLOOP_AT_END ? UNIT_DISCARD : UNIT_ERROR, "%s",
                          hertzloop_plant_said(u->plant));
    u->balanced = 0;
    return UNIT_OK;
}

size_t unit_state_bytes(void) { return sizeof(unit_known) + hertzloop_plant_about()->state_bytes; }

/* Let *state be memory for a state. */
static int roomy(unit *u, void **state) {
    if (!*state)
        *state = malloc(unit_state_bytes());
    return *state ? UNIT_OK : unit_wrong(u, UNIT_ERROR, "there is no memory for a state");
}

int unit_get_state(unit *u, void **state) {
    if (roomy(u, state) != UNIT_OK)
        return UNIT_ERROR;
    memcpy(*state, &u->known, sizeof u->known);
    hertzloop_plant_get_state(u->plant, (char *)*state + sizeof u->known);
    return UNIT_OK;
}

int unit_set_state(unit *u, const void *state) {
    if (!state)
        return unit_wrong(u, UNIT_ERROR, "there is no state to set");
    if (hertzloop_plant_set_state(u->plant, (const char *)state + sizeof u->known) != HERTZLOOP_OK)
        return unit_wrong(u, UNIT_ERROR, "%s", hertzloop_plant_said(u->plant));
    memcpy(&u->known, state, sizeof u->known);
    u->balanced = 0;
    return UNIT_OK;
}

void unit_free_state(void **state) {
    if (state) {
        free(*state);
        *state = NULL;
    }
}

int unit_write_state(unit *u, const void *state, void *bytes, size_t size) {
    if (size < unit_state_bytes())
        return unit_wrong(u, UNIT_ERROR, "a state takes %zu bytes, not %zu", unit_state_bytes(), size);
    memcpy(bytes, state, unit_state_bytes());
    return UNIT_OK;
}

int unit_read_state(unit *u, const void *bytes, size_t size, void **state) {
    if (size != unit_state_bytes())
        return unit_wrong(u, UNIT_ERROR, "a state has %zu bytes, not %zu", unit_state_bytes(), size);
    if (roomy(u, state) != UNIT_OK)
        return UNIT_ERROR;
    memcpy(*state, bytes, size);
    return UNIT_OK;
}
