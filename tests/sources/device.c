/* A brace (profile subtalar) for FMI 1, 2 or 3 (macro FMI), co-simulation and, for 2 and 3, model exchange: torque = SIGN * (-k x (1 + 4 x^2)
   - 5 (x - z)) / TORQUE_UNIT, dz/dt = (x - z) / 10 ms, x = ANGLE_UNIT * angle; it counts the times x passes 0.2 rad upward (an event). */
#include <math.h>
#include <stdint.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#ifndef SIGN
#define SIGN 1.0
#endif
#ifndef ANGLE_UNIT
#define ANGLE_UNIT 1.0
#endif
#ifndef TORQUE_UNIT
#define TORQUE_UNIT 1.0
#endif
#ifndef REFUSES /* s: discards longer steps, after this much of them; TELLS: says so */
#define REFUSES 0.0
#endif
#ifndef TELLS
#define TELLS 1
#endif
#ifndef ENDS /* s: asks to end the run then */
#define ENDS 0.0
#endif
#ifndef RETURNS /* s: (FMI 3) returns early at multiples of it; EVENTS: with an event; NAMES: names them as the next event's time instead */
#define RETURNS 0.0
#endif
#ifndef EVENTS
#define EVENTS 0
#endif
#ifndef NAMES
#define NAMES 0
#endif
#ifndef WAITS /* (FMI 2) steps are pending for so many questions */
#define WAITS 0
#endif

#ifndef ARRAYS /* (FMI 3) the angle is u[2,1], the torque y[2] and in proportion to u[2,2], the stiffness p[1] */
#define ARRAYS 0
#endif

#ifndef CLOCKED /* (FMI 3) the torque is that of the last tick of its clock */
#define CLOCKED 0
#endif

enum { ANGLE, TORQUE, STIFFNESS, STATE, RATE, TIME, SUPPLY, MEDIAL, LATERAL, SPEECH, VARIABLES };
typedef struct { char name[64]; void* environment; void* logger; } Voice;
typedef struct { double value[VARIABLES]; double reached; int ended, mode, waits, spoken; double u[4], y[3], p[2], newest, sampled; int ticked; Voice voice; } Device;
static const double TAU = 0.01;
#ifdef SUPPLIED /* V: the supply at which it gives the torque; in proportion to it */
#define GAIN (d->value[SUPPLY] / SUPPLIED)
#else
#define GAIN 1.0
#endif

#ifdef FOOT /* instead of a brace: a foot (inertia 0.005 kg m2) that a torque, held over the step, turns; it starts at 0.1 rad */
static void fresh(Device* d) { memset(d, 0, offsetof(Device, voice)); d->value[TORQUE] = 0.1; }
static void evaluate(Device* d) {}
static void advance(Device* d, double h) {
    double faster = d->value[ANGLE] / 0.005 * h;
    d->value[TORQUE] += (d->value[STATE] + 0.5 * faster) * h;
    d->value[STATE] += faster;
}
#else
static void fresh(Device* d) { memset(d, 0, offsetof(Device, voice)); d->value[STIFFNESS] = 20.0; d->u[3] = d->p[1] = 1.0; d->p[0] = 20.0; }
static void evaluate(Device* d) {
    if (ARRAYS) { d->value[ANGLE] = d->u[2]; d->value[STIFFNESS] = d->p[0]; }
    double x = ANGLE_UNIT * d->value[ANGLE];
    d->value[TORQUE] = SIGN * GAIN * (-d->value[STIFFNESS] * x * (1 + 4 * x * x) - 5.0 * (x - d->value[STATE])) / TORQUE_UNIT;
    d->newest = d->value[TORQUE];
    if (CLOCKED) d->value[TORQUE] = d->sampled;
    if (ARRAYS) { d->value[TORQUE] *= d->u[3] * d->p[1]; d->y[0] = d->u[0]; d->y[1] = d->value[TORQUE]; d->y[2] = d->u[1]; }
    d->value[RATE] = (x - d->value[STATE]) / TAU;
    /* the same torque by two cables on 40 mm, which pull with at least 5 N: in N and in kN */
    double pull = d->value[TORQUE] * TORQUE_UNIT / 0.04;
    d->value[MEDIAL] = 5.0 + (pull > 0 ? pull : 0.0);
    d->value[LATERAL] = 1e-3 * (5.0 + (pull < 0 ? -pull : 0.0));
}
static void advance(Device* d, double h) {
    double x = ANGLE_UNIT * d->value[ANGLE];
    d->value[STATE] = x + (d->value[STATE] - x) * exp(-h / TAU);
    evaluate(d);
}
#endif
static void* make(const char* name, void* environment, void* logger) {
    Device* d = calloc(1, sizeof *d);
    strncpy(d->voice.name, name, sizeof d->voice.name - 1);
    d->voice.environment = environment;
    d->voice.logger = logger;
    fresh(d);
    evaluate(d);
    return d;
}

#ifdef SPEAKS /* parameter `speech` chooses what it says, once, in the step after 10 ms (model exchange: after its end); `speak` gives that step's status */
#include <pthread.h>
#include <stdio.h>
enum { SILENT, INFORMS, WARNS, FAILS, CONTROLS, UNKNOWN, NEGATIVE, THREAD, AFTER_FREE, PRINTS, ONLY_STATUS, MANY, DIES };
static void tell(const Voice* v, int status, const char* text) {
#if FMI == 3
    ((void (*)(void*, int, const char*, const char*))v->logger)(v->environment, status, "log", text);
#else /* formatted by the host */
    ((void (*)(void*, const char*, int, const char*, const char*, ...))v->logger)(NULL, v->name, status, "log", "%s", text);
#endif
}
static void* apart(void* voice) { tell(voice, 1, "from another thread"); return NULL; }
static int speak(Device* d, double end) {
    pthread_t thread;
    int speech = (int)d->value[SPEECH];
    if (d->spoken || end < 0.0105) return 0;
    d->spoken = 1;
    switch (speech) {
        case INFORMS: tell(&d->voice, 0, "all is well"); return 0;
        case WARNS: tell(&d->voice, 0, "looking"); tell(&d->voice, 1, "strap near its end"); return 1;
        case FAILS: tell(&d->voice, 3, "strap torn\nat 10 ms"); tell(&d->voice, 0, "memory returned"); return 3;
        case CONTROLS: tell(&d->voice, 1, "\033[2J\033]0;mine\007\r\xff tidy"); return 0;
        case UNKNOWN: return 17;
        case NEGATIVE: return -3;
        case THREAD: pthread_create(&thread, NULL, apart, &d->voice); pthread_join(thread, NULL); return 0;
        case PRINTS: printf("printed by the device\n"); fflush(stdout); return 0;
        case DIES: tell(&d->voice, 3, "no licence"); abort();
        case ONLY_STATUS: d->spoken = 0; return 1;
        case MANY: for (int i = 0; i < 1000; i++) tell(&d->voice, i < 999 ? 0 : 1, i < 999 ? "on and on" : "at last"); return 0;
        default: return 0;
    }
}
static void leave(Device* d) {
    Voice voice = d->voice;
    int speech = (int)d->value[SPEECH];
    free(d);
    if (speech == AFTER_FREE) tell(&voice, 1, "from beyond");
}
#else
static int speak(Device* d, double end) { return 0; }
static void leave(Device* d) { free(d); }
#endif
static void get(Device* d, const unsigned vr[], size_t n, double v[]) { for (size_t i = 0; i < n; i++) v[i] = d->value[vr[i]]; }
static void set(Device* d, const unsigned vr[], size_t n, const double v[]) {
    for (size_t i = 0; i < n; i++) d->value[vr[i]] = v[i];
    evaluate(d);
}

#if FMI == 1
#define F(name) device_fmi##name
const char* F(GetTypesPlatform)(void) { return "standard32"; }
const char* F(GetVersion)(void) { return "1.0"; }
typedef struct { void* logger; void* allocate; void* free; void* finished; } Callbacks;
void* F(InstantiateSlave)(const char* a, const char* b, const char* c, const char* d, double t, char v, char i, Callbacks f, char l) { return make(a, NULL, f.logger); }
void F(FreeSlaveInstance)(void* c) { leave(c); }
int F(SetDebugLogging)(void* c, char on) { return 0; }
int F(InitializeSlave)(void* c, double start, char defined, double stop) { evaluate(c); return 0; }
int F(TerminateSlave)(void* c) { return 0; }
int F(ResetSlave)(void* c) { fresh(c); evaluate(c); return 0; }
int F(DoStep)(void* c, double t, double h, char again) { advance(c, h); return speak(c, t + h); }
int F(CancelStep)(void* c) { return 3; }
int F(GetReal)(void* c, const unsigned vr[], size_t n, double v[]) { get(c, vr, n, v); return 0; }
int F(SetReal)(void* c, const unsigned vr[], size_t n, const double v[]) { set(c, vr, n, v); return 0; }
#define NONE(name, type) int F(name)(void* c, const unsigned vr[], size_t n, type v) { return n ? 3 : 0; }
NONE(GetInteger, int*) NONE(GetBoolean, char*) NONE(GetString, const char**)
NONE(SetInteger, const int*) NONE(SetBoolean, const char*) NONE(SetString, const char* const*)
#define STATUS(name, type) int F(name)(void* c, int kind, type v) { return 3; }
STATUS(GetStatus, int*) STATUS(GetRealStatus, double*) STATUS(GetIntegerStatus, int*) STATUS(GetBooleanStatus, char*) STATUS(GetStringStatus, const char**)
int F(SetRealInputDerivatives)(void* c, const unsigned vr[], size_t n, const int o[], const double v[]) { return 3; }
/* model exchange */
typedef struct { char converged, references, values, terminate, upcoming; double next; } Info;
static int settled(Info* e) { memset(e, 0, sizeof *e); e->converged = 1; return 0; }
const char* F(GetModelTypesPlatform)(void) { return "standard32"; }
void* F(InstantiateModel)(const char* a, const char* b, Callbacks f, char l) { return make(a, NULL, f.logger); }
void F(FreeModelInstance)(void* c) { leave(c); }
int F(SetTime)(void* c, double t) { ((Device*)c)->value[TIME] = t; return 0; }
int F(Initialize)(void* c, char controlled, double tolerance, Info* e) { evaluate(c); return settled(e); }
int F(EventUpdate)(void* c, char intermediate, Info* e) { return settled(e); }
int F(CompletedIntegratorStep)(void* c, char* event) { *event = 0; return speak(c, ((Device*)c)->value[TIME]); }
int F(SetContinuousStates)(void* c, const double x[], size_t n) { ((Device*)c)->value[STATE] = x[0]; evaluate(c); return 0; }
int F(GetContinuousStates)(void* c, double x[], size_t n) { x[0] = ((Device*)c)->value[STATE]; return 0; }
int F(GetDerivatives)(void* c, double x[], size_t n) { x[0] = ((Device*)c)->value[RATE]; return 0; }
int F(GetEventIndicators)(void* c, double z[], size_t n) { z[0] = ((Device*)c)->value[STATE] - 0.2; return 0; }
int F(GetNominalContinuousStates)(void* c, double x[], size_t n) { x[0] = 1.0; return 0; }
int F(GetStateValueReferences)(void* c, unsigned vr[], size_t n) { vr[0] = STATE; return 0; }
int F(Terminate)(void* c) { return 0; }
int F(GetRealOutputDerivatives)(void* c, const unsigned vr[], size_t n, const int o[], double v[]) { return 3; }
#endif

#if FMI == 2
#include "fmi2Functions.h"
const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) { return fmi2OK; }
fmi2Component fmi2Instantiate(fmi2String n, fmi2Type t, fmi2String g, fmi2String r, const fmi2CallbackFunctions* f, fmi2Boolean v, fmi2Boolean l) { return make(n, NULL, (void*)f->logger); }
void fmi2FreeInstance(fmi2Component c) { leave(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tol, fmi2Real start, fmi2Boolean s, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { evaluate(c); return fmi2OK; }
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) { fresh(c); evaluate(c); return fmi2OK; }
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real v[]) { get(c, vr, n, v); return fmi2OK; }
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real v[]) { set(c, vr, n, v); return fmi2OK; }
#define NONE(name, type) fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type v[]) { return n ? fmi2Error : fmi2OK; }
NONE(fmi2GetInteger, fmi2Integer) NONE(fmi2GetBoolean, fmi2Boolean) NONE(fmi2GetString, fmi2String)
NONE(fmi2SetInteger, const fmi2Integer) NONE(fmi2SetBoolean, const fmi2Boolean) NONE(fmi2SetString, const fmi2String)
fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate* s) { if (!*s) *s = malloc(sizeof(Device)); memcpy(*s, c, sizeof(Device)); return fmi2OK; }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate s) { memcpy(c, s, sizeof(Device)); return fmi2OK; }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate* s) { free(*s); *s = NULL; return fmi2OK; }
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean n) {
    Device* d = c;
    d->ended = ENDS > 0 && t + h > ENDS + 1e-9;
    if (d->ended) { advance(d, ENDS - t); d->reached = ENDS; return fmi2Discard; }
    if (REFUSES > 0 && h > REFUSES * (1 + 1e-9)) { advance(d, REFUSES); d->reached = t + REFUSES; return fmi2Discard; }
    advance(d, h);
    d->waits = WAITS;
    return WAITS ? fmi2Pending : speak(d, t + h);
}
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind k, fmi2Status* v) { *v = ((Device*)c)->waits-- > 0 ? fmi2Pending : fmi2OK; return fmi2OK; }
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind k, fmi2Real* v) {
    *v = ((Device*)c)->reached;
    return k == fmi2LastSuccessfulTime && TELLS ? fmi2OK : fmi2Discard;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind k, fmi2Boolean* v) {
    *v = ((Device*)c)->ended;
    return k == fmi2Terminated ? fmi2OK : fmi2Discard;
}
fmi2Status fmi2CancelStep(fmi2Component c) { return fmi2Error; }
fmi2Status fmi2EnterEventMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo* e) { memset(e, 0, sizeof *e); return fmi2OK; }
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean p, fmi2Boolean* e, fmi2Boolean* t) { *e = *t = 0; return speak(c, ((Device*)c)->value[TIME]); }
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real t) { ((Device*)c)->value[TIME] = t; return fmi2OK; }
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) { ((Device*)c)->value[STATE] = x[0]; evaluate(c); return fmi2OK; }
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real x[], size_t n) { x[0] = ((Device*)c)->value[RATE]; return fmi2OK; }
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real z[], size_t n) { z[0] = ((Device*)c)->value[STATE] - 0.2; return fmi2OK; }
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) { x[0] = ((Device*)c)->value[STATE]; return fmi2OK; }
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real x[], size_t n) { x[0] = 1.0; return fmi2OK; }
#endif

#if FMI == 3
#include "fmi3Functions.h"
const char* fmi3GetVersion(void) { return "3.0"; }
fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String s[]) { return fmi3OK; }
fmi3Instance fmi3InstantiateCoSimulation(fmi3String n, fmi3String t, fmi3String r, fmi3Boolean v, fmi3Boolean l, fmi3Boolean e, fmi3Boolean er,
    const fmi3ValueReference q[], size_t nq, fmi3InstanceEnvironment env, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback u) { return make(n, env, (void*)log); }
fmi3Instance fmi3InstantiateModelExchange(fmi3String n, fmi3String t, fmi3String r, fmi3Boolean v, fmi3Boolean l, fmi3InstanceEnvironment env,
    fmi3LogMessageCallback log) { return make(n, env, (void*)log); }
void fmi3FreeInstance(fmi3Instance c) { leave(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean d, fmi3Float64 tol, fmi3Float64 s, fmi3Boolean sd, fmi3Float64 e) { return fmi3OK; }
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { evaluate(c); return fmi3OK; }
fmi3Status fmi3EnterEventMode(fmi3Instance c) { ((Device*)c)->mode = 1; return fmi3OK; }
fmi3Status fmi3EnterStepMode(fmi3Instance c) { ((Device*)c)->mode = 0; return fmi3OK; }
fmi3Status fmi3Terminate(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) { fresh(c); evaluate(c); return fmi3OK; }
enum { U = 20, Y, P }; /* references of the arrays */
static size_t width(fmi3ValueReference vr) { return !ARRAYS || vr < U ? 1 : vr == U ? 4 : vr == Y ? 3 : 2; }
static double* place(Device* d, fmi3ValueReference vr) { return width(vr) == 1 ? &d->value[vr] : vr == U ? d->u : vr == Y ? d->y : d->p; }
#define VALUES(type) \
    fmi3Status fmi3Get##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##type v[], size_t m) { \
        size_t at = 0; \
        for (size_t i = 0; i < n; i++) for (size_t k = 0; k < width(vr[i]); k++) v[at++] = (fmi3##type)place(c, vr[i])[k]; \
        return at == m ? fmi3OK : fmi3Error; \
    } \
    fmi3Status fmi3Set##type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##type v[], size_t m) { \
        size_t at = 0; \
        for (size_t i = 0; i < n; i++) for (size_t k = 0; k < width(vr[i]); k++) place(c, vr[i])[k] = v[at++]; \
        evaluate(c); \
        return at == m ? fmi3OK : fmi3Error; \
    }
VALUES(Float64) VALUES(Float32)
fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState* s) { if (!*s) *s = malloc(sizeof(Device)); memcpy(*s, c, sizeof(Device)); return fmi3OK; }
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState s) { memcpy(c, s, sizeof(Device)); return fmi3OK; }
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState* s) { free(*s); *s = NULL; return fmi3OK; }
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean n, fmi3Boolean* ev, fmi3Boolean* te, fmi3Boolean* er, fmi3Float64* l) {
    Device* d = c;
    double end = t + h, next = RETURNS > 0 ? (floor(t / RETURNS + 1e-6) + 1) * RETURNS : 2 * end;
    *ev = *te = *er = false;
    if (d->mode || (NAMES && end > next + 1e-12)) return fmi3Error;
    if (ENDS > 0 && end > ENDS + 1e-9) { advance(d, ENDS - t); *te = true; *l = ENDS; return fmi3OK; }
    if (REFUSES > 0 && h > REFUSES * (1 + 1e-9)) { advance(d, REFUSES); *l = t + REFUSES; return fmi3Discard; }
    if (next < end - 1e-12) { end = next; *er = true; *ev = EVENTS; }
    advance(d, end - t);
    *l = d->value[TIME] = end;
    return speak(d, end);
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean* a, fmi3Boolean* b, fmi3Boolean* d, fmi3Boolean* e, fmi3Boolean* f, fmi3Float64* t) {
    Device* own = c;
    *a = *b = *d = *e = *f = false;
    if (own->ticked) { own->value[TORQUE] = own->sampled = own->newest; own->ticked = 0; }
    if (NAMES) { *f = true; *t = (floor(((Device*)c)->value[TIME] / RETURNS + 1e-6) + 1) * RETURNS; }
    return fmi3OK;
}
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Clock v[]) {
    ((Device*)c)->ticked = n && v[0];
    return n && vr[0] == 40 ? fmi3OK : fmi3Error;
}
fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) { return fmi3OK; }
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean p, fmi3Boolean* e, fmi3Boolean* t) { *e = *t = false; return speak(c, ((Device*)c)->value[TIME]); }
fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 t) { ((Device*)c)->value[TIME] = t; return fmi3OK; }
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) { ((Device*)c)->value[STATE] = x[0]; evaluate(c); return fmi3OK; }
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 x[], size_t n) { x[0] = ((Device*)c)->value[RATE]; return fmi3OK; }
fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 z[], size_t n) { z[0] = ((Device*)c)->value[STATE] - 0.2; return fmi3OK; }
fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) { x[0] = ((Device*)c)->value[STATE]; return fmi3OK; }
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) { x[0] = 1.0; return fmi3OK; }
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t* n) { *n = 1; return fmi3OK; }
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t* n) { *n = 1; return fmi3OK; }
#endif
