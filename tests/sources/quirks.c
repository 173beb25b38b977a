/* Devices with one habit each (macro QUIRK), FMI 2 co-simulation: what `check` must notice, or must not mistake for a fault. Base law: -20 angle.
   NEARLY replays a restored state to 1e-7 only; BAD_RESET: its reset is an error. BALL is no brace at all: a ball that bounces. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

enum { PLAIN, LATE, REFUSES, SILENT, STALE_RESET, STALE_STATE, MEMORY, EXTRA, PRELOAD, PLASTIC, DAMPER, SNAP, BALL, ONCE, NEARLY, BAD_RESET };
enum { ANGLE, VELOCITY, TORQUE, TENSION, STATE, TIME, VARIABLES };
typedef struct { double value[VARIABLES]; } Device;
static const double OWN = 1e-3;
static double lasting;
static int alive;

static double law(Device* d) {
    double x = d->value[ANGLE], w = d->value[VELOCITY], slip;
    switch (QUIRK) {
        case SILENT: case STALE_RESET: case STALE_STATE: case NEARLY: return -20.0 * x - 5.0 * (x - d->value[STATE]);
        case MEMORY: return -20.0 * x - lasting;
        case PRELOAD: return -60.0 * (x + 0.1) - 400.0 * pow(x + 0.1, 3);
        case PLASTIC: /* a strap that slips beyond 3 N.m */
            slip = x - d->value[STATE];
            return -fmax(-3.0, fmin(3.0, 60.0 * slip));
        case DAMPER: return SIGN * -0.4 * w;
        case SNAP: return x > 0.3 ? 2.0 : -20.0 * x;
        default: return -20.0 * x;
    }
}
static void evaluate(Device* d) {
    if (QUIRK == LATE) return;
    if (QUIRK == BALL) { d->value[TORQUE] = d->value[STATE]; d->value[TENSION] = d->value[TIME]; return; }
    d->value[TORQUE] = law(d);
    d->value[TENSION] = QUIRK == EXTRA && d->value[ANGLE] > 0.2 ? NAN : fabs(d->value[TORQUE]) / 0.05;
}
static fmi2Status advance(Device* d, double h) {
    double x = d->value[ANGLE];
    if (QUIRK == REFUSES && (h < OWN * (1 - 1e-6) || fabs(h / OWN - rint(h / OWN)) > 1e-6)) return fmi2Discard;
    if (QUIRK == LATE) { d->value[TORQUE] = -20.0 * d->value[STATE]; d->value[STATE] = x; return fmi2OK; }
    if (QUIRK == PLASTIC) {
        if (x - d->value[STATE] > 0.05) d->value[STATE] = x - 0.05;
        if (x - d->value[STATE] < -0.05) d->value[STATE] = x + 0.05;
    }
    if (QUIRK == BALL) { /* height STATE, speed TIME */
        d->value[TIME] -= 9.81 * h;
        d->value[STATE] += d->value[TIME] * h;
        if (d->value[STATE] < 0) { d->value[STATE] = 0; d->value[TIME] *= -0.8; }
    } else if (QUIRK == SILENT || QUIRK == STALE_RESET || QUIRK == STALE_STATE || QUIRK == NEARLY) d->value[STATE] = x + (d->value[STATE] - x) * exp(-(QUIRK == SILENT ? OWN : h) / 0.01);
    lasting += 1e-3;
    evaluate(d);
    return fmi2OK;
}
static void fresh(Device* d) {
    double kept = d->value[STATE];
    memset(d, 0, sizeof *d);
    if (QUIRK == STALE_RESET) d->value[STATE] = kept;
    if (QUIRK == BALL) d->value[STATE] = 1.0;
    evaluate(d);
}

const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) { return fmi2OK; }
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions* f, fmi2Boolean v, fmi2Boolean l) {
    Device* d = calloc(1, sizeof *d);
    if (QUIRK == ONCE && alive) return NULL;
    alive++;
    fresh(d);
    return d;
}
void fmi2FreeInstance(fmi2Component c) { alive--; free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tol, fmi2Real start, fmi2Boolean s, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { evaluate(c); return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { fresh(c); return QUIRK == BAD_RESET ? fmi2Error : fmi2OK; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) v[i] = ((Device*)c)->value[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real v[]) {
    for (size_t i = 0; i < n; i++) ((Device*)c)->value[vr[i]] = v[i];
    evaluate(c);
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean n) { return advance(c, h); }
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* s) { if (!*s) *s = malloc(sizeof(Device)); memcpy(*s, c, sizeof(Device)); return fmi2OK; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) {
    double kept = ((Device*)c)->value[STATE];
    memcpy(c, s, sizeof(Device));
    if (QUIRK == STALE_STATE) ((Device*)c)->value[STATE] = kept;
    if (QUIRK == NEARLY) ((Device*)c)->value[STATE] *= 1 + 1e-6;
    return fmi2OK;
}
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* s) { free(*s); *s = NULL; return fmi2OK; }
#define NONE(name, type) fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type v[]) { return n ? fmi2Error : fmi2OK; }
NONE(fmi2GetInteger, fmi2Integer) NONE(fmi2GetBoolean, fmi2Boolean) NONE(fmi2GetString, fmi2String)
NONE(fmi2SetInteger, const fmi2Integer) NONE(fmi2SetBoolean, const fmi2Boolean) NONE(fmi2SetString, const fmi2String)
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status* v) { return fmi2Error; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real* v) { return fmi2Error; }
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean* v) { return fmi2Error; }
