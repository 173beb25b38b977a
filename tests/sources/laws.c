/* Laws for FMI 2 co-simulation (macro LAW). SAMPLED: torque = -k angle - c velocity, evaluated at the end of the initialisation and
   every `period`, held in between. Braces with free steps, computed in a step only: STRAP slack up to 8 deg, then stiffening, with Coulomb and
   viscous friction, never pushing; SLACK up to 12 deg, then 900 N.m/rad; THICK: shear-thickening in the speed, found from the angle; DAHL:
   hysteresis; CABLE: wound in by a motor that is sampled every 5 ms; LATE: a spring that answers one step late; OVER: an over-centre spring;
   LOCK: locks above 300 deg/s, then pushes outward (pushes back with RIGHT); STOP: an end stop at 35 deg, the wrong way; WOBBLE: a spring whose last digit
   wobbles; SLOW: a spring that takes PAUSE microseconds a step; FED: 15 N.m per unit of its angle, in degrees.
   CONTROLLER: excitations of eight muscles = base + gain * max(0, stretch velocity), at once.
   WHEN: outputs are computed AT_ONCE, at the END of the initialisation and in steps, or in a STEP only. START_VALUES of all variables. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "fmi2Functions.h"

#ifndef SIGN
#define SIGN 1.0
#endif
#ifndef PAUSE
#define PAUSE 0
#endif
enum { SAMPLED, CONTROLLER, STRAP, SLACK, THICK, DAHL, CABLE, LATE, OVER, LOCK, STOP, WOBBLE, SLOW, FED };
enum { AT_ONCE, END, STEP };
enum { ANGLE, VELOCITY, TORQUE, STIFFNESS, DAMPING, PERIOD };
enum { STRETCH = 0, EXCITATION = 8, GAIN = 16, BASE = 17, VARIABLES = 18 };
typedef struct { double value[VARIABLES]; double due, last, state; } Model;

static void evaluate(Model* m) {
    double* v = m->value;
    if (LAW == SAMPLED) v[TORQUE] = -v[STIFFNESS] * v[ANGLE] - v[DAMPING] * v[VELOCITY];
    else for (int k = 0; k < 8; k++) v[EXCITATION + k] = v[BASE] + v[GAIN] * fmax(0.0, v[STRETCH + k]);
}
static double brace(Model* m, double h) {
    static const double DEG = 0.017453292519943295;
    double x = m->value[ANGLE], w = m->value[VELOCITY], s, r, moved = x - m->last;
    switch (LAW) {
        case STRAP:
            s = fabs(x) / DEG - 8.0;
            if (s <= 0.0) return 0.0;
            r = copysign(1.2 * s * (1 + s / 15 * (s / 15)), x) + 0.02 * w / DEG + 2.0 * tanh(w / DEG);
            return x > 0 ? -fmax(r, 0.0) : -fmin(r, 0.0);
        case SLACK:
            s = fabs(x) - 12.0 * DEG;
            return s > 0 ? -copysign(900.0 * s, x) : 0.0;
        case THICK:
            r = moved / h;
            return -0.2 * r * (1 + fmin(pow(r / 3.5, 4), 40.0));
        case DAHL:
            for (int i = 0; i < 50; i++) m->state += 300.0 * moved / 50 * (1 - m->state / 12.0 * ((moved > 0) - (moved < 0)));
            return -10.0 * x - m->state;
        case CABLE:
            return -0.05 * fmax(0.0, 5.0 + 1500.0 * fmax(x - 0.1, 0.0) + m->state);
        case OVER:
            return 30.0 * x - 300.0 * x * x * x;
        case LOCK:
            if (fabs(w) > 300.0 * DEG && !m->due) { m->due = 1; m->state = x; }
            if (fabs(w) < 0.3) m->due = 0;
            return m->due ? SIGN * 20.0 * (x - m->state) : 0.0;
        case STOP:
            s = x - 35.0 * DEG;
            return s > 0 ? 60.0 * s : 0.0;
        case WOBBLE:
            m->state += 1;
            return -40.0 * (1 + 2.3e-16 * (fmod(m->state, 3.0) - 1)) * x;
        case SLOW:
            usleep(PAUSE);
            return -40.0 * x;
        case FED:
            return -15.0 * x / DEG;
        default: /* LATE */
            return -60.0 * m->last;
    }
}
static void wind(Model* m, double end) { /* the motor of CABLE */
    for (; m->due <= end + 1e-9; m->due += 0.005) {
        double x = m->value[ANGLE], v = (x - m->last) / 0.005;
        m->last = x;
        m->state = fmax(0.0, fmin(400.0, 400.0 * fmax(x, 0.0) + 10.0 * fmax(v, 0.0)));
    }
}
static void fresh(Model* m) {
    static const double start[VARIABLES] = START_VALUES;
    memset(m, 0, sizeof *m);
    memcpy(m->value, start, sizeof start);
}

const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) { return fmi2OK; }
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions* f, fmi2Boolean v, fmi2Boolean l) {
    Model* m = malloc(sizeof *m);
    fresh(m);
    return m;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tol, fmi2Real start, fmi2Boolean s, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Model* m = c;
    if (WHEN != STEP) evaluate(m);
    if (LAW == SAMPLED) m->due = m->value[PERIOD];
    if (LAW == THICK) m->last = m->value[ANGLE];
    return fmi2OK;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { fresh(c); return fmi2OK; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[]) {
    Model* m = c;
    if (LAW == CONTROLLER && WHEN == AT_ONCE) evaluate(m);
    for (size_t i = 0; i < n; i++) v[i] = m->value[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) ((Model*)c)->value[vr[i]] = v[i];
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keep) {
    Model* m = c;
    if (LAW == CONTROLLER) evaluate(m);
    else if (LAW != SAMPLED) {
        if (LAW == CABLE) wind(m, time + step);
        m->value[TORQUE] = brace(m, step);
        if (LAW != CABLE) m->last = m->value[ANGLE];
    } else
        for (; m->due <= time + step + 1e-9; m->due += m->value[PERIOD]) evaluate(m);
    return fmi2OK;
}
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* s) {
    if (!*s) *s = malloc(sizeof(Model));
    memcpy(*s, c, sizeof(Model));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { memcpy(c, s, sizeof(Model)); return fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* s) { free(*s); *s = NULL; return fmi2OK; }
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
