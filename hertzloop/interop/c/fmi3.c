/* The unit by the Functional Mock-up Interface 3.0 for co-simulation. The declarations are those of
   the standard, as far as this unit needs them. */

#include <stdbool.h>
#include <stdint.h>

#include "unit.h"

typedef void *fmi3Instance;
typedef uint32_t fmi3ValueReference;
typedef const char *fmi3String;
typedef int fmi3Status; /* OK, warning, discard, error, fatal */
typedef void fmi3Logger(void *, fmi3Status, fmi3String, fmi3String);

static void tell(const unit *u, int status, const char *sentence) {
    fmi3Logger *logger = (fmi3Logger *)(intptr_t)u->logger;
    if (logger)
        logger(u->environment, status,
               status == UNIT_DISCARD ? "logStatusDiscard" : "logStatusError", sentence);
}

HERTZLOOP_API const char *fmi3GetVersion(void) { return "3.0"; }

HERTZLOOP_API fmi3Status fmi3SetDebugLogging(fmi3Instance c, bool on, size_t count,
                                             const fmi3String categories[]) {
    (void)c, (void)on, (void)count, (void)categories; /* what is wrong is said in any case */
    return UNIT_OK;
}

HERTZLOOP_API fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
    bool eventModeUsed, bool earlyReturnAllowed, const fmi3ValueReference intermediate[],
    size_t count, void *environment, fmi3Logger *logger, void *intermediateUpdate) {
    (void)resources, (void)visible, (void)logging, (void)earlyReturnAllowed, (void)intermediate;
    (void)count, (void)intermediateUpdate;
    unit *u = unit_new(name, token, tell, environment, (void *)(intptr_t)logger);
    if (u && eventModeUsed) {
        unit_wrong(u, UNIT_ERROR, "this unit has no event mode");
        unit_free(u);
        return NULL;
    }
    return u;
}

HERTZLOOP_API fmi3Instance fmi3InstantiateModelExchange(void) { return NULL; }
HERTZLOOP_API fmi3Instance fmi3InstantiateScheduledExecution(void) { return NULL; }
HERTZLOOP_API void fmi3FreeInstance(fmi3Instance c) { unit_free(c); }

HERTZLOOP_API fmi3Status fmi3EnterInitializationMode(fmi3Instance c, bool toleranceDefined,
                                                     double tolerance, double start_s,
                                                     bool stopDefined, double stop_s) {
    (void)toleranceDefined, (void)tolerance, (void)stopDefined, (void)stop_s;
    unit *u = c;
    int status = unit_turn(u, "fmi3EnterInitializationMode", INSTANTIATED, INITIALISING);
    if (status == UNIT_OK)
        u->known.start_s = start_s;
    return status;
}

HERTZLOOP_API fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    return unit_turn(c, "fmi3ExitInitializationMode", INITIALISING, STEPPING);
}

HERTZLOOP_API fmi3Status fmi3Terminate(fmi3Instance c) {
    return unit_turn(c, "fmi3Terminate", STEPPING, TERMINATED);
}

HERTZLOOP_API fmi3Status fmi3Reset(fmi3Instance c) { return unit_reset(c); }

static int fits(const unit *u, size_t references, size_t values) {
    if (references == values)
        return 1;
    unit_wrong(u, UNIT_ERROR, "%zu values for %zu variables; each has one", values, references);
    return 0;
}

HERTZLOOP_API fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference references[],
                                        size_t count, double values[], size_t room) {
    int status = fits(c, count, room) ? UNIT_OK : UNIT_ERROR;
    for (size_t i = 0; i < count && status == UNIT_OK; i++)
        status = unit_get_real(c, references[i], values + i);
    return status;
}

HERTZLOOP_API fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference references[],
                                        size_t count, const double values[], size_t given) {
    int status = fits(c, count, given) ? UNIT_OK : UNIT_ERROR;
    for (size_t i = 0; i < count && status == UNIT_OK; i++)
        status = unit_set_real(c, references[i], values[i]);
    return status;
}

HERTZLOOP_API fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference references[],
                                      size_t count, int64_t values[], size_t room) {
    int status = fits(c, count, room) ? UNIT_OK : UNIT_ERROR;
    for (size_t i = 0; i < count && status == UNIT_OK; i++)
        status = unit_get_integer(c, references[i], values + i);
    return status;
}

HERTZLOOP_API fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference references[],
                                      size_t count, const int64_t values[], size_t given) {
    int status = fits(c, count, given) ? UNIT_OK : UNIT_ERROR;
    for (size_t i = 0; i < count && status == UNIT_OK; i++)
        status = unit_set_integer(c, references[i], values[i]);
    return status;
}

/* The unit has no variables of these types. */
#define NONE_OF(type)                                                                             \
    HERTZLOOP_API fmi3Status fmi3##type(fmi3Instance c, const void *references, size_t count) {    \
        (void)references;                                                                         \
        return count ? unit_refuse(c, "variables for fmi3" #type) : UNIT_OK;                      \
    }
NONE_OF(GetFloat32)
NONE_OF(GetInt8)
NONE_OF(GetUInt8)
NONE_OF(GetInt16)
NONE_OF(GetUInt16)
NONE_OF(GetInt32)
NONE_OF(GetUInt32)
NONE_OF(GetUInt64)
NONE_OF(GetBoolean)
NONE_OF(GetString)
NONE_OF(GetBinary)
NONE_OF(GetClock)
NONE_OF(SetFloat32)
NONE_OF(SetInt8)
NONE_OF(SetUInt8)
NONE_OF(SetInt16)
NONE_OF(SetUInt16)
NONE_OF(SetInt32)
NONE_OF(SetUInt32)
NONE_OF(SetUInt64)
NONE_OF(SetBoolean)
NONE_OF(SetString)
NONE_OF(SetBinary)
NONE_OF(SetClock)

HERTZLOOP_API fmi3Status fmi3GetFMUState(fmi3Instance c, void **state) {
    return unit_get_state(c, state);
}

HERTZLOOP_API fmi3Status fmi3SetFMUState(fmi3Instance c, void *state) {
    return unit_set_state(c, state);
}

HERTZLOOP_API fmi3Status fmi3FreeFMUState(fmi3Instance c, void **state) {
    (void)c;
    unit_free_state(state);
    return UNIT_OK;
}

HERTZLOOP_API fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, void *state, size_t *size) {
    (void)c, (void)state;
    *size = unit_state_bytes();
    return UNIT_OK;
}

HERTZLOOP_API fmi3Status fmi3SerializeFMUState(fmi3Instance c, void *state, uint8_t bytes[],
                                               size_t size) {
    return unit_write_state(c, state, bytes, size);
}

HERTZLOOP_API fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const uint8_t bytes[], size_t size,
                                                 void **state) {
    return unit_read_state(c, bytes, size, state);
}

HERTZLOOP_API fmi3Status fmi3DoStep(fmi3Instance c, double now_s, double step_s, bool noStateBefore,
                                    bool *eventNeeded, bool *terminate, bool *early, double *last_s) {
    (void)noStateBefore;
    int status = unit_step(c, now_s, step_s);
    *eventNeeded = *terminate = *early = false;
    *last_s = unit_time_s(c);
    return status;
}

/* Of what this unit does not have; callers give more arguments, which stay where they are. */
#define NOT_HERE(name)                                                                            \
    HERTZLOOP_API fmi3Status fmi3##name(fmi3Instance c) { return unit_refuse(c, "fmi3" #name); }
NOT_HERE(GetNumberOfVariableDependencies)
NOT_HERE(GetVariableDependencies)
NOT_HERE(GetDirectionalDerivative)
NOT_HERE(GetAdjointDerivative)
NOT_HERE(EnterConfigurationMode)
NOT_HERE(ExitConfigurationMode)
NOT_HERE(EnterEventMode)
NOT_HERE(EnterStepMode)
NOT_HERE(EnterContinuousTimeMode)
NOT_HERE(GetIntervalDecimal)
NOT_HERE(GetIntervalFraction)
NOT_HERE(GetShiftDecimal)
NOT_HERE(GetShiftFraction)
NOT_HERE(SetIntervalDecimal)
NOT_HERE(SetIntervalFraction)
NOT_HERE(SetShiftDecimal)
NOT_HERE(SetShiftFraction)
NOT_HERE(EvaluateDiscreteStates)
NOT_HERE(UpdateDiscreteStates)
NOT_HERE(CompletedIntegratorStep)
NOT_HERE(SetTime)
NOT_HERE(SetContinuousStates)
NOT_HERE(GetContinuousStateDerivatives)
NOT_HERE(GetEventIndicators)
NOT_HERE(GetContinuousStates)
NOT_HERE(GetNominalsOfContinuousStates)
NOT_HERE(GetNumberOfEventIndicators)
NOT_HERE(GetNumberOfContinuousStates)
NOT_HERE(GetOutputDerivatives)
NOT_HERE(ActivateModelPartition)
