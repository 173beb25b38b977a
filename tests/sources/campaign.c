/* One library for many braces (FMI 2 co-simulation), whose numbers stand in the GUID, separated by commas: sign, stiffness [N.m/rad], damping
   [N.m.s/rad], slack [rad], period [s] (0: every step), and what one unit of its angles [rad], velocities [rad/s] and torques [N.m] is.
   About each of its axes: torque = -sign (stiffness (|x| - slack) + damping v in the direction of x, never less than 0) beyond the slack. Angles,
   velocities and torques of AXES axes have the value references 3 k, 3 k + 1, 3 k + 2. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

enum { AXES = 3, SIGN = 0, STIFFNESS, DAMPING, SLACK, PERIOD, ANGLE, VELOCITY, TORQUE, NUMBERS };
typedef struct { double value[3 * AXES], number[NUMBERS], due; } Model;

static void evaluate(Model* m) {
    for (int k = 0; k < AXES; k++) {
        double x = m->value[3 * k] * m->number[ANGLE], v = m->value[3 * k + 1] * m->number[VELOCITY];
        double way = x < 0 ? -1.0 : 1.0, taut = fabs(x) - m->number[SLACK];
        double pull = taut > 0 ? m->number[STIFFNESS] * taut + m->number[DAMPING] * v * way : 0.0;
        m->value[3 * k + 2] = -m->number[SIGN] * way * fmax(pull, 0.0) / m->number[TORQUE];
    }
}
const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) { return fmi2OK; }
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String guid, fmi2String r, const fmi2CallbackFunctions* f, fmi2Boolean v, fmi2Boolean l) {
    Model* m = calloc(1, sizeof *m);
    char* at = (char*)guid;
    for (int k = 0; k < NUMBERS; k++, at++) m->number[k] = strtod(at, &at);
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tol, fmi2Real start, fmi2Boolean s, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Model* m = c;
    evaluate(m);
    m->due = m->number[PERIOD];
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    Model* m = c;
    memset(m->value, 0, sizeof m->value);
    m->due = 0;
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) v[i] = ((Model*)c)->value[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) ((Model*)c)->value[vr[i]] = v[i];
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keep) {
    Model* m = c;
    if (m->number[PERIOD] == 0) evaluate(m);
    else
        for (; m->due <= time + step + 1e-9; m->due += m->number[PERIOD]) evaluate(m);
    return fmi2OK;
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* s) { return fmi2Error; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { return fmi2Error; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* s) { return fmi2Error; }
#define NOTHING(name, type) fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) { return n ? fmi2Error : fmi2OK; }
NOTHING(fmi2GetInteger, fmi2Integer)
NOTHING(fmi2GetBoolean, fmi2Boolean)
NOTHING(fmi2SetInteger, const fmi2Integer)
NOTHING(fmi2SetBoolean, const fmi2Boolean)
NOTHING(fmi2SetString, const fmi2String)
NOTHING(fmi2GetString, fmi2String)
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status* v) { return fmi2Error; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real* v) { return fmi2Error; }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean* v) { return fmi2Error; }
