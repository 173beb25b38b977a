/* A brace (profile subtalar) that fails on demand: parameter `fault` chooses how, at the step after 10 ms. Fault injection for tests. */
#define _GNU_SOURCE
#include <locale.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "fmi2Functions.h"

enum { ANGLE, TORQUE, STIFFNESS, FAULT, VARIABLES };
enum {
    NONE, SEGFAULT, ABORT, EXIT, HANG_STEP, ERROR, FATAL, DISCARD, NOT_A_NUMBER, POSITIVE_INFINITY, NEGATIVE_INFINITY, HUGE_VALUE_OUT,
    FLOOD, LEAK, CHANGE_FOLDER, CHANGE_LOCALE, FORK, HANG_START, HANG_RESET, SPIN, GORGE, HANG_LOAD
};

typedef struct { double value[VARIABLES]; char name[64]; const fmi2CallbackFunctions* callbacks; } Device;

#ifdef RESERVES /* bytes that the library asks for when it is loaded */
static char reserved[RESERVES] __attribute__((used));
#endif

static void hang(void) {
#ifdef MARK /* a file that says so */
    fclose(fopen(MARK, "w"));
#endif
    for (;;) pause();
}

const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) { return fmi2OK; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions* callbacks,
                              fmi2Boolean visible, fmi2Boolean logging) {
    Device* device = calloc(1, sizeof *device);
    device->value[STIFFNESS] = 20.0;
    device->value[FAULT] = FAULT_AT_START;
    device->callbacks = callbacks;
    if (FAULT_AT_START == HANG_LOAD) hang();
    return device;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start, fmi2Boolean s, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    if (((Device*)c)->value[FAULT] == HANG_START) hang();
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    Device* device = c;
    if (device->value[FAULT] == HANG_RESET) hang();
    memset(device->value, 0, sizeof device->value);
    device->value[STIFFNESS] = 20.0;
    device->value[FAULT] = FAULT_AT_START;
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Device*)c)->value[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Device* device = c;
    for (size_t i = 0; i < n; i++) device->value[vr[i]] = value[i];
    device->value[TORQUE] = -device->value[STIFFNESS] * device->value[ANGLE];
    return fmi2OK;
}
#define NOTHING(name, type) fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) { return n ? fmi2Error : fmi2OK; }
NOTHING(fmi2GetInteger, fmi2Integer)
NOTHING(fmi2GetBoolean, fmi2Boolean)
NOTHING(fmi2GetString, fmi2String)
NOTHING(fmi2SetInteger, const fmi2Integer)
NOTHING(fmi2SetBoolean, const fmi2Boolean)
NOTHING(fmi2SetString, const fmi2String)
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* s) { return fmi2Error; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { return fmi2Error; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* s) { return fmi2Error; }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate s, size_t* n) { return fmi2Error; }
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate s, fmi2Byte b[], size_t n) { return fmi2Error; }
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte b[], size_t n, fmi2FMUstate* s) { return fmi2Error; }
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference u[], size_t nu, const fmi2ValueReference k[], size_t nk,
                                        const fmi2Real du[], fmi2Real dy[]) { return fmi2Error; }
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer o[], const fmi2Real v[]) { return fmi2Error; }
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer o[], fmi2Real v[]) { return fmi2Error; }
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status* v) { return fmi2Error; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real* v) { return fmi2Error; }
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind k, fmi2Integer* v) { return fmi2Error; }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean* v) { return fmi2Error; }
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind k, fmi2String* v) { return fmi2Error; }

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keep) {
    Device* device = c;
    char line[1024];
    int fault = time >= 0.01 && time < 0.01 + step ? (int)device->value[FAULT] : NONE;
    device->value[TORQUE] = -device->value[STIFFNESS] * device->value[ANGLE];
    switch (fault) {
        case SEGFAULT: raise(SIGSEGV); break;
        case ABORT: abort();
        case EXIT: exit(0);
        case HANG_STEP: hang(); break;
        case ERROR: return fmi2Error;
        case FATAL: return fmi2Fatal;
        case DISCARD: return fmi2Discard;
        case NOT_A_NUMBER: device->value[TORQUE] = NAN; break;
        case POSITIVE_INFINITY: device->value[TORQUE] = INFINITY; break;
        case NEGATIVE_INFINITY: device->value[TORQUE] = -INFINITY; break;
        case HUGE_VALUE_OUT: device->value[TORQUE] = 1e300; break;
        case FLOOD: /* 100 MB */
            memset(line, 'x', sizeof line - 1);
            line[sizeof line - 1] = '\n';
            for (int i = 0; i < 100 * 1024; i++) fwrite(line, 1, sizeof line, stdout);
            fflush(stdout);
            break;
        case LEAK: memset(malloc(64 << 20), 1, 64 << 20); break;
        case CHANGE_FOLDER: if (chdir("/")) return fmi2Error; break;
        case CHANGE_LOCALE: setlocale(LC_ALL, "de_DE.UTF-8"); break;
        case SPIN: for (volatile long i = 0;; i++) { }
        case GORGE: memset(malloc(64ull << 30), 1, 64ull << 30); break; /* more than there is: a null pointer under a limit of memory */
        case FORK: if (fork() == 0) { for (;;) pause(); } break;
        default: break;
    }
    return fmi2OK;
}
