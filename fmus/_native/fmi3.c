/* The FMI 3.0 co-simulation face of a compiled device. */

#include "device.h"

#include <fmi3Functions.h>
#include <stdio.h>
#include <stdlib.h>

typedef const fmi3ValueReference *References;

static void say(Instance *m, Status status, const char *text) {
    fmi3LogMessageCallback log = (fmi3LogMessageCallback)m->logger;
    if (log) log(m->environment, (fmi3Status)status, "logAll", text);
}

#define DONE(call) return (fmi3Status)(call)
#define REFUSE(...) return (fmi3Status)device_refuse(c, __VA_ARGS__)
/* Every variable is a scalar, so there are as many values as references. */
#define ONE_EACH(n, n_values) \
    if ((n) != (n_values)) REFUSE("%s: %zu values for %zu variables, which are scalars", model.name, (size_t)(n_values), (size_t)(n))

const char *fmi3GetVersion(void) { return fmi3Version; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) { return fmi3OK; }

static fmi3Instance refused(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    char text[256];
    snprintf(text, sizeof text, "%s: only co-simulation without event mode is offered", model.name);
    if (log) log(environment, fmi3Error, "logAll", text);
    return NULL;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean event_mode, fmi3Boolean early_return, const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    return event_mode ? refused(environment, log) : device_open(name, token, resources, say, environment, (void *)log);
}
fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    return refused(environment, log);
}
fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) {
    return refused(environment, log);
}

void fmi3FreeInstance(fmi3Instance c) { device_close(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stop_defined, fmi3Float64 stop) {
    DONE(device_start(c, start));
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { DONE(device_begin(c)); }
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) { return device_reset(c), fmi3OK; }

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean no_state_before, fmi3Boolean *event, fmi3Boolean *end,
                      fmi3Boolean *early, fmi3Float64 *reached) {
    Status status = device_step(c, time, step);
    *event = *end = *early = fmi3False;
    *reached = status == OK ? time + step : time;
    DONE(status);
}

fmi3Status fmi3GetFloat64(fmi3Instance c, References r, size_t n, fmi3Float64 out[], size_t n_values) {
    ONE_EACH(n, n_values);
    DONE(device_get(c, r, n, out));
}
fmi3Status fmi3SetFloat64(fmi3Instance c, References r, size_t n, const fmi3Float64 in[], size_t n_values) {
    ONE_EACH(n, n_values);
    DONE(device_set(c, r, n, in));
}

fmi3Status fmi3GetInt64(fmi3Instance c, References r, size_t n, fmi3Int64 out[], size_t n_values) {
    ONE_EACH(n, n_values);
    Status status = device_check(c, r, n, ENUMERATION, 0);
    for (size_t k = 0; k < n && status == OK; k++) out[k] = (fmi3Int64)((Instance *)c)->call.values[r[k]];
    DONE(status);
}
fmi3Status fmi3SetInt64(fmi3Instance c, References r, size_t n, const fmi3Int64 in[], size_t n_values) {
    ONE_EACH(n, n_values);
    Status status = device_check(c, r, n, ENUMERATION, 1);
    for (size_t k = 0; k < n && status == OK; k++) device_write(c, r[k], (double)in[k]);
    DONE(status);
}

/* Types that no variable has, and functions that the description does not offer. */
#define NONE(n, word) return (n) ? (fmi3Status)device_refuse(c, "%s: there are no " word, model.name) : fmi3OK
#define NO_TYPE(kind, word) \
    fmi3Status fmi3Get##kind(fmi3Instance c, References r, size_t n, fmi3##kind out[], size_t n_values) { NONE(n, word); } \
    fmi3Status fmi3Set##kind(fmi3Instance c, References r, size_t n, const fmi3##kind in[], size_t n_values) { NONE(n, word); }
NO_TYPE(Float32, "numbers of single precision")
NO_TYPE(Int8, "8-bit integers")
NO_TYPE(UInt8, "8-bit integers")
NO_TYPE(Int16, "16-bit integers")
NO_TYPE(UInt16, "16-bit integers")
NO_TYPE(Int32, "32-bit integers")
NO_TYPE(UInt32, "32-bit integers")
NO_TYPE(UInt64, "unsigned integers")
NO_TYPE(Boolean, "booleans")
NO_TYPE(String, "texts")
fmi3Status fmi3GetBinary(fmi3Instance c, References r, size_t n, size_t sizes[], fmi3Binary out[], size_t n_values) { NONE(n, "binary variables"); }
fmi3Status fmi3SetBinary(fmi3Instance c, References r, size_t n, const size_t sizes[], const fmi3Binary in[], size_t n_values) {
    NONE(n, "binary variables");
}
fmi3Status fmi3GetClock(fmi3Instance c, References r, size_t n, fmi3Clock out[]) { NONE(n, "clocks"); }
fmi3Status fmi3SetClock(fmi3Instance c, References r, size_t n, const fmi3Clock in[]) { NONE(n, "clocks"); }
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, References r, size_t n, fmi3Float64 out[], fmi3IntervalQualifier q[]) { NONE(n, "clocks"); }
fmi3Status fmi3GetIntervalFraction(fmi3Instance c, References r, size_t n, fmi3UInt64 count[], fmi3UInt64 per[], fmi3IntervalQualifier q[]) {
    NONE(n, "clocks");
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance c, References r, size_t n, fmi3Float64 out[]) { NONE(n, "clocks"); }
fmi3Status fmi3GetShiftFraction(fmi3Instance c, References r, size_t n, fmi3UInt64 count[], fmi3UInt64 per[]) { NONE(n, "clocks"); }
fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, References r, size_t n, const fmi3Float64 in[]) { NONE(n, "clocks"); }
fmi3Status fmi3SetIntervalFraction(fmi3Instance c, References r, size_t n, const fmi3UInt64 count[], const fmi3UInt64 per[]) { NONE(n, "clocks"); }
fmi3Status fmi3SetShiftDecimal(fmi3Instance c, References r, size_t n, const fmi3Float64 in[]) { NONE(n, "clocks"); }
fmi3Status fmi3SetShiftFraction(fmi3Instance c, References r, size_t n, const fmi3UInt64 count[], const fmi3UInt64 per[]) { NONE(n, "clocks"); }
fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time) { NONE(1, "clocks"); }

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) { DONE(device_save(c, state)); }
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) { DONE(device_restore(c, state)); }
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    if (state) free(*state), *state = NULL;
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) { return *size = device_state_size(), fmi3OK; }
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte out[], size_t size) { DONE(device_state_to_bytes(c, state, out, size)); }
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte in[], size_t size, fmi3FMUState *state) {
    DONE(device_state_from_bytes(c, in, size, state));
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, References unknowns, size_t n_unknowns, References knowns, size_t n_knowns,
                                        const fmi3Float64 seed[], size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    ONE_EACH(n_knowns, n_seed);
    ONE_EACH(n_unknowns, n_sensitivity);
    DONE(device_differentiate(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, References unknowns, size_t n_unknowns, References knowns, size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    REFUSE("%s: adjoint derivatives are not provided", model.name);
}
fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, References r, size_t n, const fmi3Int32 orders[], fmi3Float64 out[], size_t n_values) {
    REFUSE("%s: derivatives of outputs over time are not provided", model.name);
}
fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference r, size_t *n) {
    REFUSE("%s: dependencies stand in the description", model.name);
}
fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference r, size_t of[], fmi3ValueReference on[], size_t at[], fmi3DependencyKind kinds[],
                                       size_t n) {
    REFUSE("%s: dependencies stand in the description", model.name);
}

#define NO_MODE(function, ...) \
    fmi3Status fmi3##function(fmi3Instance c, ##__VA_ARGS__) { REFUSE("%s: fmi3" #function " belongs to a mode that is not offered", model.name); }
NO_MODE(EnterEventMode)
NO_MODE(EnterConfigurationMode)
NO_MODE(ExitConfigurationMode)
NO_MODE(EnterStepMode)
NO_MODE(EvaluateDiscreteStates)
NO_MODE(UpdateDiscreteStates, fmi3Boolean *again, fmi3Boolean *end, fmi3Boolean *nominals, fmi3Boolean *values, fmi3Boolean *defined, fmi3Float64 *next)
NO_MODE(EnterContinuousTimeMode)
NO_MODE(CompletedIntegratorStep, fmi3Boolean no_state_before, fmi3Boolean *event, fmi3Boolean *end)
NO_MODE(SetTime, fmi3Float64 time)
NO_MODE(SetContinuousStates, const fmi3Float64 in[], size_t n)
NO_MODE(GetContinuousStateDerivatives, fmi3Float64 out[], size_t n)
NO_MODE(GetEventIndicators, fmi3Float64 out[], size_t n)
NO_MODE(GetContinuousStates, fmi3Float64 out[], size_t n)
NO_MODE(GetNominalsOfContinuousStates, fmi3Float64 out[], size_t n)
NO_MODE(GetNumberOfEventIndicators, size_t *n)
NO_MODE(GetNumberOfContinuousStates, size_t *n)
