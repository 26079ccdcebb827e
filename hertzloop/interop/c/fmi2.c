/* The unit by the Functional Mock-up Interface 2.0 for co-simulation. The declarations are those of
   the standard, as far as this unit needs them. */

#include <stdint.h>

#include "unit.h"

typedef void *fmi2Component;
typedef unsigned fmi2ValueReference;
typedef int fmi2Boolean;
typedef char fmi2Byte;
typedef const char *fmi2String;
typedef int fmi2Status; /* OK, warning, discard, error, fatal, pending */
typedef void fmi2Logger(void *, fmi2String, fmi2Status, fmi2String, fmi2String, ...);

typedef struct {
    fmi2Logger *logger;
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(void *, fmi2Status);
    void *componentEnvironment;
} fmi2CallbackFunctions;

static void tell(const unit *u, int status, const char *sentence) {
    fmi2Logger *logger = (fmi2Logger *)(intptr_t)u->logger;
    if (logger)
        logger(u->environment, u->name, status,
               status == UNIT_DISCARD ? "logStatusDiscard" : "logStatusError", sentence);
}

HERTZLOOP_API const char *fmi2GetTypesPlatform(void) { return "default"; }
HERTZLOOP_API const char *fmi2GetVersion(void) { return "2.0"; }

HERTZLOOP_API fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
                                             const fmi2String categories[]) {
    (void)c, (void)on, (void)count, (void)categories; /* what is wrong is said in any case */
    return UNIT_OK;
}

HERTZLOOP_API fmi2Component fmi2Instantiate(fmi2String name, int type, fmi2String guid,
                                            fmi2String resources,
                                            const fmi2CallbackFunctions *functions,
                                            fmi2Boolean visible, fmi2Boolean logging) {
    (void)resources, (void)visible, (void)logging;
    fmi2Logger *logger = functions ? functions->logger : NULL;
    void *environment = functions ? functions->componentEnvironment : NULL;
    unit *u = unit_new(name, guid, tell, environment, (void *)(intptr_t)logger);
    if (u && type != 1) {
        unit_wrong(u, UNIT_ERROR, "this unit is for co-simulation only");
        unit_free(u);
        return NULL;
    }
    return u;
}

HERTZLOOP_API void fmi2FreeInstance(fmi2Component c) { unit_free(c); }

HERTZLOOP_API fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean toleranceDefined,
                                             double tolerance, double start_s, fmi2Boolean stopDefined,
                                             double stop_s) {
    (void)toleranceDefined, (void)tolerance, (void)stopDefined, (void)stop_s;
    unit *u = c;
    int status = unit_turn(u, "fmi2SetupExperiment", INSTANTIATED, INSTANTIATED);
    if (status == UNIT_OK)
        u->known.start_s = start_s;
    return status;
}

HERTZLOOP_API fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return unit_turn(c, "fmi2EnterInitializationMode", INSTANTIATED, INITIALISING);
}

HERTZLOOP_API fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return unit_turn(c, "fmi2ExitInitializationMode", INITIALISING, STEPPING);
}

HERTZLOOP_API fmi2Status fmi2Terminate(fmi2Component c) {
    return unit_turn(c, "fmi2Terminate", STEPPING, TERMINATED);
}

HERTZLOOP_API fmi2Status fmi2Reset(fmi2Component c) { return unit_reset(c); }

HERTZLOOP_API fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference references[],
                                     size_t count, double values[]) {
    int status = UNIT_OK;
    for (size_t i = 0; i < count && status == UNIT_OK; i++)
        status = unit_get_real(c, references[i], values + i);
    return status;
}

HERTZLOOP_API fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference references[],
                                        size_t count, int values[]) {
    int status = UNIT_OK;
    for (size_t i = 0; i < count && status == UNIT_OK; i++) {
        int64_t value = 0;
        status = unit_get_integer(c, references[i], &value);
        values[i] = (int)value;
    }
    return status;
}

HERTZLOOP_API fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference references[],
                                     size_t count, const double values[]) {
    int status = UNIT_OK;
    for (size_t i = 0; i < count && status == UNIT_OK; i++)
        status = unit_set_real(c, references[i], values[i]);
    return status;
}

HERTZLOOP_API fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference references[],
                                        size_t count, const int values[]) {
    int status = UNIT_OK;
    for (size_t i = 0; i < count && status == UNIT_OK; i++)
        status = unit_set_integer(c, references[i], values[i]);
    return status;
}

/* The unit has no variables of these types. */
#define NONE_OF(type)                                                                             \
    HERTZLOOP_API fmi2Status fmi2##type(fmi2Component c, const void *references, size_t count,     \
                                        const void *values) {                                     \
        (void)references, (void)values;                                                           \
        return count ? unit_refuse(c, "variables for fmi2" #type) : UNIT_OK;                      \
    }
NONE_OF(GetBoolean)
NONE_OF(GetString)
NONE_OF(SetBoolean)
NONE_OF(SetString)

HERTZLOOP_API fmi2Status fmi2GetFMUstate(fmi2Component c, void **state) {
    return unit_get_state(c, state);
}

HERTZLOOP_API fmi2Status fmi2SetFMUstate(fmi2Component c, void *state) {
    return unit_set_state(c, state);
}

HERTZLOOP_API fmi2Status fmi2FreeFMUstate(fmi2Component c, void **state) {
    (void)c;
    unit_free_state(state);
    return UNIT_OK;
}

HERTZLOOP_API fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, void *state, size_t *size) {
    (void)c, (void)state;
    *size = unit_state_bytes();
    return UNIT_OK;
}

HERTZLOOP_API fmi2Status fmi2SerializeFMUstate(fmi2Component c, void *state, fmi2Byte bytes[],
                                               size_t size) {
    return unit_write_state(c, state, bytes, size);
}

HERTZLOOP_API fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[],
                                                 size_t size, void **state) {
    return unit_read_state(c, bytes, size, state);
}

HERTZLOOP_API fmi2Status fmi2DoStep(fmi2Component c, double now_s, double step_s,
                                    fmi2Boolean noStateBefore) {
    (void)noStateBefore;
    return unit_step(c, now_s, step_s);
}

/* Steps are done when fmi2DoStep returns. */
HERTZLOOP_API fmi2Status fmi2CancelStep(fmi2Component c) {
    return unit_wrong(c, UNIT_ERROR, "there is no step under way to cancel");
}

HERTZLOOP_API fmi2Status fmi2GetRealStatus(fmi2Component c, int kind, double *value) {
    *value = unit_time_s(c); /* the end of the last step that succeeded */
    return kind == 2 ? UNIT_OK : UNIT_DISCARD;
}

HERTZLOOP_API fmi2Status fmi2GetBooleanStatus(fmi2Component c, int kind, fmi2Boolean *value) {
    (void)c;
    *value = 0; /* it asks for no end */
    return kind == 3 ? UNIT_OK : UNIT_DISCARD;
}

/* Of what this unit does not have; callers give more arguments, which stay where they are. */
#define NOT_HERE(name)                                                                            \
    HERTZLOOP_API fmi2Status fmi2##name(fmi2Component c) { return unit_refuse(c, "fmi2" #name); }
NOT_HERE(GetDirectionalDerivative)
NOT_HERE(SetRealInputDerivatives)
NOT_HERE(GetRealOutputDerivatives)
NOT_HERE(GetStatus)
NOT_HERE(GetIntegerStatus)
NOT_HERE(GetStringStatus)
