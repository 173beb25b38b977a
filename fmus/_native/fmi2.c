/* The FMI 2.0 co-simulation face of a compiled device. */

#include "device.h"

#include <fmi2Functions.h>
#include <stdio.h>
#include <stdlib.h>

typedef const fmi2ValueReference *References;

static void say(Instance *m, Status status, const char *text) {
    fmi2CallbackLogger logger = (fmi2CallbackLogger)m->logger;
    if (logger) logger(m->environment, m->name, (fmi2Status)status, "logAll", "%s", text);
}

#define DONE(call) return (fmi2Status)(call)
#define REFUSE(...) return (fmi2Status)device_refuse(c, __VA_ARGS__)

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) { return fmi2OK; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging) {
    void *logger = callbacks ? (void *)callbacks->logger : NULL, *environment = callbacks ? callbacks->componentEnvironment : NULL;
    if (type != fmi2CoSimulation) {
        if (logger) callbacks->logger(environment, name, fmi2Error, "logAll", "%s: only co-simulation is offered", model.name);
        return NULL;
    }
    return device_open(name, guid, resources, say, environment, logger);
}

void fmi2FreeInstance(fmi2Component c) { device_close(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start, fmi2Boolean stop_defined,
                               fmi2Real stop) {
    DONE(device_start(c, start));
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { DONE(device_begin(c)); }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { return device_reset(c), fmi2OK; }

fmi2Status fmi2GetReal(fmi2Component c, References r, size_t n, fmi2Real out[]) { DONE(device_get(c, r, n, out)); }
fmi2Status fmi2SetReal(fmi2Component c, References r, size_t n, const fmi2Real in[]) { DONE(device_set(c, r, n, in)); }

fmi2Status fmi2GetInteger(fmi2Component c, References r, size_t n, fmi2Integer out[]) {
    Status status = device_check(c, r, n, ENUMERATION, 0);
    for (size_t k = 0; k < n && status == OK; k++) out[k] = (fmi2Integer)((Instance *)c)->call.values[r[k]];
    DONE(status);
}
fmi2Status fmi2SetInteger(fmi2Component c, References r, size_t n, const fmi2Integer in[]) {
    Status status = device_check(c, r, n, ENUMERATION, 1);
    for (size_t k = 0; k < n && status == OK; k++) device_write(c, r[k], in[k]);
    DONE(status);
}

#define NONE(kind, type, word) \
    fmi2Status fmi2Get##kind(fmi2Component c, References r, size_t n, type out[]) { \
        if (!n) return fmi2OK; \
        REFUSE("%s: there are no " word, model.name); \
    } \
    fmi2Status fmi2Set##kind(fmi2Component c, References r, size_t n, const type in[]) { \
        if (!n) return fmi2OK; \
        REFUSE("%s: there are no " word, model.name); \
    }
NONE(Boolean, fmi2Boolean, "booleans")
NONE(String, fmi2String, "texts")

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean no_state_before) { DONE(device_step(c, time, step)); }
fmi2Status fmi2CancelStep(fmi2Component c) { REFUSE("%s: steps are synchronous", model.name); }

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) { DONE(device_save(c, state)); }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { DONE(device_restore(c, state)); }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (state) free(*state), *state = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) { return *size = device_state_size(), fmi2OK; }
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte out[], size_t size) { DONE(device_state_to_bytes(c, state, out, size)); }
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte in[], size_t size, fmi2FMUstate *state) {
    DONE(device_state_from_bytes(c, in, size, state));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, References unknowns, size_t n_unknowns, References knowns, size_t n_knowns,
                                        const fmi2Real seed[], fmi2Real sensitivity[]) {
    DONE(device_differentiate(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, References r, size_t n, const fmi2Integer order[], const fmi2Real in[]) {
    REFUSE("%s: inputs are held over a step: their derivatives cannot be set", model.name);
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, References r, size_t n, const fmi2Integer order[], fmi2Real out[]) {
    REFUSE("%s: derivatives of outputs over time are not provided", model.name);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *out) { return fmi2Discard; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *out) { return fmi2Discard; }
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *out) { return fmi2Discard; }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *out) { return fmi2Discard; }
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *out) { return fmi2Discard; }
