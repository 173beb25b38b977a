/* A brace in C: cubic torques about the three body-fixed X-Y-Z Euler angles of the calcaneus in the tibia (equation and source: README.md).
   Your law goes between the two lines; the rest is FMI 2.0 for co-simulation and stays. */
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"

#define GUID "{brace_template_c}" /* as in modelDescription.xml */

/* ---- the brace ---- */

enum { /* value references, as in modelDescription.xml */
    ANGLE_SCALE, TORQUE_SCALE,
    ANGLE,                   /* x, y, z [rad] */
    TORQUE = ANGLE + 3,      /* x, y, z [N.m], of the brace on the foot */
    STIFFNESS = TORQUE + 3,  /* x, y, z [N.m/rad], -d(torque)/d(angle) */
    VARIABLES = STIFFNESS + 3
};
static const double START[VARIABLES] = {1.0, 1.0};

static const double POLYNOMIAL[3][3] = { /* N.m of the angle in rad: linear, quadratic, cubic */
    {9.52095038, -29.57608094, 169.01588105},
    {3.61796125, -10.1612135, 64.5279144},
    {5.98187224, 15.74951827, 33.6780792},
};

/* Outputs of the present parameters and inputs. */
static void outputs(double v[VARIABLES]) {
    double f = v[ANGLE_SCALE], s = v[TORQUE_SCALE];
    for (int k = 0; k < 3; k++) {
        const double *p = POLYNOMIAL[k];
        double x = f * v[ANGLE + k];
        v[TORQUE + k] = -s * x * (p[0] + x * (p[1] + x * p[2]));
        v[STIFFNESS + k] = s * f * (p[0] + x * (2 * p[1] + x * 3 * p[2]));
    }
}

/* From time to time + step [s] with the inputs held. A brace with memory keeps it in further entries of v and moves it here. */
static void advance(double v[VARIABLES], double time, double step) {
    (void)time, (void)step;
    outputs(v);
}

/* ---- FMI 2.0 ---- */

typedef struct { double v[VARIABLES]; } Brace;

static fmi2Status known(const fmi2ValueReference vr[], size_t n) {
    for (size_t i = 0; i < n; i++)
        if (vr[i] >= VARIABLES) return fmi2Error;
    return fmi2OK;
}

const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) { return fmi2OK; }

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions* functions,
                              fmi2Boolean visible, fmi2Boolean logging) {
    if (type != fmi2CoSimulation || strcmp(guid, GUID)) return NULL;
    Brace* brace = calloc(1, sizeof *brace);
    if (brace) fmi2Reset(brace);
    return brace;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean given, fmi2Real tolerance, fmi2Real start, fmi2Boolean ends, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { outputs(((Brace*)c)->v); return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    memcpy(((Brace*)c)->v, START, sizeof START);
    outputs(((Brace*)c)->v);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    if (known(vr, n) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < n; i++) value[i] = ((Brace*)c)->v[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    if (known(vr, n) != fmi2OK) return fmi2Error;
    for (size_t i = 0; i < n; i++) ((Brace*)c)->v[vr[i]] = value[i];
    outputs(((Brace*)c)->v);
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean final) {
    advance(((Brace*)c)->v, time, step);
    return fmi2OK;
}
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* state) {
    if (!*state && !(*state = malloc(sizeof(Brace)))) return fmi2Error;
    memcpy(*state, c, sizeof(Brace));
    return fmi2OK;
}
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { memcpy(c, state, sizeof(Brace)); return fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* state) { free(*state); *state = NULL; return fmi2OK; }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t* size) { *size = sizeof(Brace); return fmi2OK; }
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (size < sizeof(Brace)) return fmi2Error;
    memcpy(bytes, state, sizeof(Brace));
    return fmi2OK;
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate* state) {
    if (size != sizeof(Brace) || !(*state = malloc(sizeof(Brace)))) return fmi2Error;
    memcpy(*state, bytes, sizeof(Brace));
    return fmi2OK;
}

/* what this brace does not have */
#define NO_VARIABLES(name, type) fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) { return n ? fmi2Error : fmi2OK; }
NO_VARIABLES(fmi2GetInteger, fmi2Integer)
NO_VARIABLES(fmi2GetBoolean, fmi2Boolean)
NO_VARIABLES(fmi2GetString, fmi2String)
NO_VARIABLES(fmi2SetInteger, const fmi2Integer)
NO_VARIABLES(fmi2SetBoolean, const fmi2Boolean)
NO_VARIABLES(fmi2SetString, const fmi2String)
#define NO_STATUS(name, type) fmi2Status name(fmi2Component c, const fmi2StatusKind kind, type* value) { return fmi2Discard; }
NO_STATUS(fmi2GetStatus, fmi2Status)
NO_STATUS(fmi2GetRealStatus, fmi2Real)
NO_STATUS(fmi2GetIntegerStatus, fmi2Integer)
NO_STATUS(fmi2GetBooleanStatus, fmi2Boolean)
NO_STATUS(fmi2GetStringStatus, fmi2String)
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], const fmi2Real value[]) {
    return fmi2Error;
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[]) {
    return fmi2Error;
}
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference of[], size_t n, const fmi2ValueReference by[], size_t m,
                                        const fmi2Real along[], fmi2Real value[]) {
    return fmi2Error;
}
