/* A landing as one FMU of FMI 2.0 co-simulation: it loads the FMUs in its resources and steps them as the master does
   (native_steps.c), by the plan in resources/plan.txt that export/container.py writes. The start is that of
   assembly.py, loops.py and schemes/, so that every number is the master's.

   Lines of the plan, fields separated by tabs, slots are places on the bus of values:
     container  FORMAT  GUID  STEP  jacobi|sequential  MEMBERS  SLOTS  RESTS  VARIABLES
     member     NAME  2|3  TOKEN  LIBRARY-LINUX  LIBRARY-WINDOWS  INPUTS  OUTPUTS  DIRECT  foreign|ours
     input      REFERENCE  SLOT-INITIALISING  SLOT-AT-START  SLOT-RUNNING  FACTOR  OFFSET     those of the member before
     output     REFERENCE
     rest       SLOT  SOURCE-SLOT  MEMBER
     value      real|integer|boolean  MEMBER  REFERENCE  TYPE  parameter|input  set|start  NUMBER
     slot       SLOT                                                                 an output of the container
   The last two are the container's variables in the order of their value references. */

#include "native_steps.c"

#include <errno.h>
#include <fmi2Functions.h>
#include <fmi3FunctionTypes.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#ifdef _WIN32
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#else
#include <dlfcn.h>
#if defined(__GLIBC__) && defined(__x86_64__) /* of libdl, which older systems have these in */
__asm__(".symver dlopen,dlopen@GLIBC_2.2.5");
__asm__(".symver dlsym,dlsym@GLIBC_2.2.5");
__asm__(".symver dlclose,dlclose@GLIBC_2.2.5");
__asm__(".symver dlerror,dlerror@GLIBC_2.2.5");
#endif
#endif

enum { FORMAT = 1, MESSAGE = 2048, PATHS = 4096, ROUNDS = 20 };
static const double CONSISTENT = 1e-12, SAME = 1e-6;

typedef struct {
    fmi2InstantiateTYPE *instantiate;
    fmi2FreeInstanceTYPE *release;
    fmi2SetupExperimentTYPE *setup;
    fmi2EnterInitializationModeTYPE *enter;
    fmi2ExitInitializationModeTYPE *leave;
    fmi2TerminateTYPE *terminate;
    fmi2SetIntegerTYPE *set_integer;
    fmi2SetBooleanTYPE *set_boolean;
    fmi2GetBooleanStatusTYPE *boolean_status;
} Two;

typedef struct {
    fmi3InstantiateCoSimulationTYPE *instantiate;
    fmi3FreeInstanceTYPE *release;
    fmi3EnterInitializationModeTYPE *enter;
    fmi3ExitInitializationModeTYPE *leave;
    fmi3TerminateTYPE *terminate;
    fmi3SetInt32TYPE *set_int32;
    fmi3SetInt64TYPE *set_int64;
    fmi3SetBooleanTYPE *set_boolean;
} Three;

typedef struct Container Container;

typedef struct {
    Container *container;
    char *name, *token, *library;
    int foreign;
    void *handle; /* of the library */
    Two two;
    Three three;
    fmi2CallbackFunctions callbacks;
    Reference *references; /* of inputs, then of outputs */
    int64_t *sources;      /* of inputs: initialising, at the start, running */
    double *links;         /* factors, then offsets */
    bool event, ended, early;
    double reached;
} Part;

typedef enum { KIND_SLOT, KIND_REAL, KIND_INTEGER, KIND_BOOLEAN } Kind;

typedef struct {
    Kind kind;
    int64_t member; /* or the slot of an output */
    Reference reference;
    char *type;
    int held; /* an input of the member that nothing feeds */
    int set;  /* by the landing, or by the host */
    double number;
} Value;

typedef struct {
    int64_t slot, source, member;
} Rest;

struct Container {
    fmi2CallbackLogger logger;
    fmi2ComponentEnvironment environment;
    char *name, *resources, folder[PATHS];
    int loud;       /* the host wants all messages */
    int open;       /* the members are instantiated */
    int running;    /* initialised */
    int stale;      /* something was set since they were, or they never were */
    int broken;     /* may only be reset or freed */
    int terminated; /* a member asked to end the run */
    char *plan;
    Value *values, *first; /* as they are, and as they stand in the plan */
    int64_t n_values, n_rests, zero;
    Rest *rests;
    Part *parts;
    Run run;
    double step, time, size, start, stop;
    int64_t point; /* steps taken */
    int stops;
    fenv_t floats;
};

/* ---- messages */

/* As the form itself, with every % doubled: not every host knows the arguments behind it. */
static void say(Container *c, fmi2Status status, const char *form, ...) {
    char text[MESSAGE], whole[2 * MESSAGE], *out = whole;
    va_list rest;
    if (!c->logger || (!c->loud && status == fmi2OK)) return;
    va_start(rest, form);
    vsnprintf(text, sizeof text, form, rest);
    va_end(rest);
    for (const char *at = text; *at; at++) {
        if (*at == '%') *out++ = '%';
        *out++ = *at;
    }
    *out = 0;
    c->logger(c->environment, c->name, status, "logAll", whole);
}

#define FAIL(c, ...) (say(c, fmi2Error, __VA_ARGS__), (c)->broken = 1, fmi2Error)
#define REFUSE(c, ...) (say(c, fmi2Error, __VA_ARGS__), fmi2Error)

static void said2(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category, fmi2String form, ...) {
    Part *part = environment;
    char text[MESSAGE];
    va_list rest;
    if (!part || !form) return;
    va_start(rest, form);
    vsnprintf(text, sizeof text, form, rest);
    va_end(rest);
    say(part->container, status, "%s: %s", part->name, text);
}

static void said3(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String text) {
    Part *part = environment;
    if (part && text) say(part->container, (fmi2Status)status, "%s: %s", part->name, text);
}

static const char *const ANSWERS[] = {"", "warned", "discarded the call", "reported an error", "reported a fatal error", "is still at work"};

static const char *answer(int status) { return 0 <= status && status <= fmi2Pending ? ANSWERS[status] : "gave an unknown status"; }

/* ---- files and libraries */

/* The path of a folder that the host passed: a path, or a file URI; it ends in a slash. */
static int path_of(const char *folder, char out[PATHS]) {
    size_t n = 0;
    int uri = !strncmp(folder, "file:", 5);
    if (uri) {
        folder += 5;
        if (!strncmp(folder, "//", 2))
            for (folder += 2; *folder && *folder != '/';) folder++; /* the name of the machine */
#ifdef _WIN32
        if (folder[0] == '/' && folder[1] && folder[2] == ':') folder++;
#endif
    }
    for (; *folder; folder++) {
        unsigned code;
        if (n + 3 > PATHS) return 0;
        if (uri && *folder == '%' && sscanf(folder + 1, "%2x", &code) == 1) out[n++] = (char)code, folder += 2;
        else out[n++] = *folder;
    }
    if (n && out[n - 1] != '/' && out[n - 1] != '\\') out[n++] = '/';
    out[n] = 0;
    return n > 0;
}

#ifdef _WIN32
static wchar_t *wide(const char *path, wchar_t out[PATHS]) {
    int n = MultiByteToWideChar(CP_UTF8, 0, path, -1, out, PATHS);
    for (int k = 0; k < n; k++)
        if (out[k] == L'/') out[k] = L'\\';
    return n ? out : NULL;
}

static FILE *open_file(const char *path) {
    wchar_t place[PATHS];
    return wide(path, place) ? _wfopen(place, L"rb") : NULL;
}

static void *open_library(const char *path, char *why) {
    wchar_t place[PATHS];
    HMODULE found = wide(path, place) ? LoadLibraryExW(place, NULL, LOAD_WITH_ALTERED_SEARCH_PATH) : NULL;
    if (!found) snprintf(why, MESSAGE / 2, "error %lu of Windows", GetLastError());
    return (void *)found;
}

static void *function_of(void *library, const char *name) { return (void *)GetProcAddress(library, name); }
static void close_library(void *library) { FreeLibrary(library); }
enum { ON_WINDOWS = 1 };
#else
static FILE *open_file(const char *path) { return fopen(path, "rb"); }
static void *open_library(const char *path, char *why) {
    void *found = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!found) snprintf(why, MESSAGE / 2, "%s", dlerror());
    return found;
}
static void *function_of(void *library, const char *name) { return dlsym(library, name); }
static void close_library(void *library) { dlclose(library); }
enum { ON_WINDOWS = 0 };
#endif

static char *content_of(Container *c, const char *name) {
    char path[PATHS + 64];
    snprintf(path, sizeof path, "%s%s", c->folder, name);
    FILE *file = open_file(path);
    if (!file) return say(c, fmi2Error, "%s cannot be read: %s; unpack the FMU with its resources", path, strerror(errno)), NULL;
    char *text = NULL;
    long size = fseek(file, 0, SEEK_END) ? -1 : ftell(file);
    if (size >= 0 && !fseek(file, 0, SEEK_SET) && (text = calloc(1, (size_t)size + 1)) && fread(text, 1, (size_t)size, file) != (size_t)size)
        free(text), text = NULL;
    fclose(file);
    if (!text) say(c, fmi2Error, "%s cannot be read", path);
    return text;
}

/* ---- the plan */

typedef struct {
    char *next, *field[10];
    int n;
} Reader;

/* The next line, split at its tabs; whether it has this first word and this many fields. */
static int line(Reader *reader, const char *word, int n) {
    char *at = reader->next;
    if (!*at) return 0;
    char *end = strchr(at, '\n');
    reader->next = end ? end + 1 : at + strlen(at);
    if (end) *end = 0;
    for (reader->n = 0; reader->n < 10; at++) {
        reader->field[reader->n++] = at;
        if (!(at = strchr(at, '\t'))) break;
        *at = 0;
    }
    return reader->n == n && !strcmp(reader->field[0], word);
}

static int64_t whole(Reader *r, int k) { return (int64_t)strtoll(r->field[k], NULL, 10); }
static double number(Reader *r, int k) { return strtod(r->field[k], NULL); }
static int within(int64_t value, int64_t limit) { return 0 <= value && value < limit; }

static int read_member(Container *c, Reader *r, Part *part, Member *m, int64_t *slot) {
    if (!line(r, "member", 10)) return 0;
    part->container = c, part->name = r->field[1], part->token = r->field[3], part->library = r->field[4 + ON_WINDOWS];
    part->foreign = !strcmp(r->field[9], "foreign");
    m->fmi = (int32_t)whole(r, 2), m->inputs = whole(r, 6), m->outputs = whole(r, 7), m->direct = whole(r, 8);
    m->first_input = *slot, m->first_output = *slot + m->inputs, *slot += m->inputs + m->outputs;
    if (!within(m->inputs, c->run.slots) || !within(m->outputs, c->run.slots) || !within(m->direct, m->outputs + 1) || *slot > c->zero) return 0;
    part->references = calloc((size_t)(m->inputs + m->outputs) + 1, sizeof(Reference));
    part->sources = calloc((size_t)(3 * m->inputs) + 1, sizeof(int64_t));
    part->links = calloc((size_t)(2 * m->inputs) + 1, sizeof(double));
    if (!part->references || !part->sources || !part->links) return 0;
    m->input_references = part->references, m->output_references = part->references + m->inputs;
    m->factor = part->links, m->offset = part->links + m->inputs, m->final = 1;
    m->event = &part->event, m->terminate = &part->ended, m->early = &part->early, m->reached = &part->reached;
    for (int64_t k = 0; k < m->inputs; k++) {
        if (!line(r, "input", 7)) return 0;
        part->references[k] = (Reference)whole(r, 1);
        for (int phase = 0; phase < 3; phase++)
            if (!within(part->sources[phase * m->inputs + k] = whole(r, 2 + phase), c->run.slots)) return 0;
        part->links[k] = number(r, 5), part->links[m->inputs + k] = number(r, 6);
        m->scaled |= part->links[k] != 1.0 || part->links[m->inputs + k] != 0.0;
    }
    for (int64_t k = 0; k < m->outputs; k++) {
        if (!line(r, "output", 2)) return 0;
        part->references[m->inputs + k] = (Reference)whole(r, 1);
    }
    return 1;
}

static int read_value(Container *c, Reader *r, Value *v) {
    if (line(r, "slot", 2)) return v->kind = KIND_SLOT, within(v->member = whole(r, 1), c->zero);
    if (r->n != 8 || strcmp(r->field[0], "value")) return 0;
    v->kind = !strcmp(r->field[1], "real") ? KIND_REAL : !strcmp(r->field[1], "integer") ? KIND_INTEGER : KIND_BOOLEAN;
    v->member = whole(r, 2), v->reference = (Reference)whole(r, 3), v->type = r->field[4];
    v->held = !strcmp(r->field[5], "input"), v->set = !strcmp(r->field[6], "set"), v->number = number(r, 7);
    return within(v->member, c->run.count);
}

static int read_plan(Container *c, const char *guid) {
    Reader r = {c->plan = content_of(c, "plan.txt"), {0}, 0};
    if (!c->plan) return 0;
    if (!line(&r, "container", 9) || whole(&r, 1) != FORMAT) return say(c, fmi2Error, "its plan is of another version; export the landing anew"), 0;
    if (guid && strcmp(guid, r.field[2])) return say(c, fmi2Error, "the GUID %.80s is not that of this plan, %s; unpack the FMU again", guid, r.field[2]), 0;
    c->step = number(&r, 3), c->run.jacobi = !strcmp(r.field[4], "jacobi");
    int64_t members = whole(&r, 5), slots = whole(&r, 6), slot = 0;
    c->n_rests = whole(&r, 7), c->n_values = whole(&r, 8), c->zero = slots - 1 - c->n_rests;
    if (!(c->step > 0) || !within(members, 1000) || !within(slots, 1000000) || !within(c->n_rests, slots) || !within(c->n_values, 10000000)) return 0;
    c->parts = calloc((size_t)members + 1, sizeof *c->parts), c->run.members = calloc((size_t)members + 1, sizeof(Member));
    c->run.bus = calloc((size_t)slots, sizeof(double)), c->run.rows = calloc((size_t)(2 * slots), sizeof(double));
    c->rests = calloc((size_t)c->n_rests + 1, sizeof *c->rests);
    c->values = calloc((size_t)c->n_values + 1, sizeof *c->values), c->first = calloc((size_t)c->n_values + 1, sizeof *c->first);
    if (!c->parts || !c->run.members || !c->run.bus || !c->run.rows || !c->rests || !c->values || !c->first) return 0;
    c->run.count = members, c->run.slots = slots, c->run.points = 1, c->run.time = &c->time, c->run.step = &c->size;
    for (int64_t k = 0; k < members; k++)
        if (!read_member(c, &r, &c->parts[k], &c->run.members[k], &slot)) return 0;
    for (int64_t k = 0; k < c->n_rests; k++) {
        if (!line(&r, "rest", 4)) return 0;
        c->rests[k] = (Rest){whole(&r, 1), whole(&r, 2), whole(&r, 3)};
        if (!within(c->rests[k].slot, slots) || !within(c->rests[k].source, slots) || !within(c->rests[k].member, members)) return 0;
    }
    for (int64_t k = 0; k < c->n_values; k++)
        if (!read_value(c, &r, &c->first[k])) return 0;
    memcpy(c->values, c->first, (size_t)c->n_values * sizeof(Value));
    return 1;
}

/* ---- the members */

static int load(Part *part, Member *m) {
    char path[2 * PATHS], why[MESSAGE / 2] = "";
    if (!*part->library) return say(part->container, fmi2Error, "%s: it has no library for this system", part->name), 0;
    snprintf(path, sizeof path, "%s%s/%s", part->container->folder, part->name, part->library);
    if (!(part->handle = open_library(path, why))) return say(part->container, fmi2Error, "%s: its library cannot be loaded: %s", part->name, why), 0;
    struct {
        const char *name;
        void *place;
    } two[] = {
        {"fmi2Instantiate", &part->two.instantiate},
        {"fmi2FreeInstance", &part->two.release},
        {"fmi2SetupExperiment", &part->two.setup},
        {"fmi2EnterInitializationMode", &part->two.enter},
        {"fmi2ExitInitializationMode", &part->two.leave},
        {"fmi2Terminate", &part->two.terminate},
        {"fmi2SetInteger", &part->two.set_integer},
        {"fmi2SetBoolean", &part->two.set_boolean},
        {"fmi2GetBooleanStatus", &part->two.boolean_status},
        {"fmi2SetReal", &m->set},
        {"fmi2GetReal", &m->get},
        {"fmi2DoStep", &m->step},
        {0},
    }, three[] = {
        {"fmi3InstantiateCoSimulation", &part->three.instantiate},
        {"fmi3FreeInstance", &part->three.release},
        {"fmi3EnterInitializationMode", &part->three.enter},
        {"fmi3ExitInitializationMode", &part->three.leave},
        {"fmi3Terminate", &part->three.terminate},
        {"fmi3SetInt32", &part->three.set_int32},
        {"fmi3SetInt64", &part->three.set_int64},
        {"fmi3SetBoolean", &part->three.set_boolean},
        {"fmi3SetFloat64", &m->set},
        {"fmi3GetFloat64", &m->get},
        {"fmi3DoStep", &m->step},
        {0},
    }, *needed = m->fmi == 3 ? three : two;
    for (; needed->name; needed++) {
        void *found = function_of(part->handle, needed->name);
        if (!found) return say(part->container, fmi2Error, "%s: its library has no %s", part->name, needed->name), 0;
        memcpy(needed->place, &found, sizeof found);
    }
    return 1;
}

static int instantiate(Container *c, Part *part, Member *m) {
    char place[2 * PATHS];
    if (m->fmi == 3) {
        snprintf(place, sizeof place, "%s%s/resources/", c->folder, part->name);
        m->instance = part->three.instantiate(part->name, part->token, place, false, true, false, false, NULL, 0, part, said3, NULL);
    } else {
        snprintf(place, sizeof place, "%s%s%s/resources", c->resources, c->resources[strlen(c->resources) - 1] == '/' ? "" : "/", part->name);
        part->callbacks = (fmi2CallbackFunctions){said2, calloc, free, NULL, part};
        m->instance = part->two.instantiate(part->name, fmi2CoSimulation, part->token, place, &part->callbacks, fmi2False, fmi2True);
    }
    fesetenv(&c->floats);
    if (!m->instance) say(c, fmi2Error, "%s: cannot be instantiated", part->name);
    return m->instance != NULL;
}

static void release(Container *c) {
    for (int64_t k = 0; c->run.members && k < c->run.count; k++) {
        Member *m = &c->run.members[k];
        if (!m->instance) continue;
        if (m->fmi == 3) c->parts[k].three.release(m->instance);
        else c->parts[k].two.release(m->instance);
        m->instance = NULL;
    }
    c->open = 0;
}

static int open_members(Container *c) {
    for (int64_t k = 0; k < c->run.count; k++) {
        Part *part = &c->parts[k];
        Member *m = &c->run.members[k];
        m->environment = part->foreign ? &c->floats : NULL;
        if ((!part->handle && !load(part, m)) || !instantiate(c, part, m)) return 0;
    }
    return c->open = 1;
}

/* ---- the start */

static fmi2Status done(Container *c, int64_t member, int status, const char *doing) {
    fesetenv(&c->floats);
    if (status == fmi2OK || status == fmi2Warning) return fmi2OK;
    return FAIL(c, "%s: %s %s", c->parts[member].name, answer(status), doing);
}

static fmi2Status pass(Container *c, Value *v) {
    Member *m = &c->run.members[v->member];
    Three *three = &c->parts[v->member].three;
    Two *two = &c->parts[v->member].two;
    fmi2Integer integer = (fmi2Integer)v->number;
    fmi3Int32 narrow = (fmi3Int32)v->number;
    fmi3Int64 ample = (fmi3Int64)v->number;
    bool truth = v->number != 0;
    int status;
    if (v->kind == KIND_REAL)
        status = m->fmi == 3 ? ((Fmi3Access *)m->set)(m->instance, &v->reference, 1, &v->number, 1) : ((Fmi2Access *)m->set)(m->instance, &v->reference, 1, &v->number);
    else if (m->fmi == 2)
        status = v->kind == KIND_INTEGER ? two->set_integer(m->instance, &v->reference, 1, &integer) : two->set_boolean(m->instance, &v->reference, 1, &(fmi2Boolean){truth});
    else if (v->kind == KIND_BOOLEAN)
        status = three->set_boolean(m->instance, &v->reference, 1, &truth, 1);
    else if (!strcmp(v->type, "Int32"))
        status = three->set_int32(m->instance, &v->reference, 1, &narrow, 1);
    else
        status = three->set_int64(m->instance, &v->reference, 1, &ample, 1);
    return done(c, v->member, status, "setting a parameter");
}

/* Values of one causality that were set, of one member (-1: of all). */
static fmi2Status pass_values(Container *c, int held, int64_t member) {
    fmi2Status status = fmi2OK;
    for (int64_t k = 0; k < c->n_values && status == fmi2OK; k++) {
        Value *v = &c->values[k];
        if (v->kind != KIND_SLOT && v->set && v->held == held && (member < 0 || v->member == member)) status = pass(c, v);
    }
    return status;
}

/* Which slots the inputs are fed from: while initialising, at the start, running. */
static void feed_from(Container *c, int phase) {
    for (int64_t k = 0; k < c->run.count; k++) {
        Member *m = &c->run.members[k];
        m->sources = c->parts[k].sources + phase * m->inputs;
        m->fed_back = m->inputs_set = 0;
        for (int64_t i = 0; i < m->inputs; i++)
            m->fed_back |= m->sources[i] < c->zero && m->sources[i] >= m->first_output + m->outputs;
    }
}

static fmi2Status consistent(Container *c) {
    Run *run = &c->run;
    double *before = run->rows; /* free until the first step */
    memcpy(before, run->bus, (size_t)run->slots * sizeof(double));
    for (int round = 0; round < ROUNDS; round++) {
        int outcome = exchange(run);
        if (outcome == SETTING) return done(c, run->member, run->status, "setting its inputs at the start");
        if (outcome == READING) return done(c, run->member, run->status, "reading its outputs at the start");
        if (!all_finite(run->bus, run->slots)) return FAIL(c, "a value is not finite at the start");
        double largest = 0;
        for (int64_t k = 0; k < run->slots; k++) largest = fmax(largest, fabs(run->bus[k] - before[k]) / fmax(1.0, fabs(before[k])));
        if (largest <= CONSISTENT) return fmi2OK;
        memcpy(before, run->bus, (size_t)run->slots * sizeof(double));
    }
    return FAIL(c, "the values at the start do not settle: an algebraic loop, which is solved by the master alone");
}

static fmi2Status begin(Container *c) {
    fegetenv(&c->floats);
    if (c->point >= 0) release(c); /* it started before with other parameters */
    if (!c->open && !open_members(c)) return c->broken = 1, fmi2Error;
    memset(c->run.bus, 0, (size_t)c->run.slots * sizeof(double));
    c->point = 0, c->run.member = c->run.point = 0, c->run.stepped = 0;
    if (pass_values(c, 0, -1)) return fmi2Error;
    for (int64_t k = 0; k < c->run.count; k++) {
        Member *m = &c->run.members[k];
        Part *part = &c->parts[k];
        int answered;
        if (m->fmi == 3) answered = part->three.enter(m->instance, false, 0.0, c->start, c->stops, c->stop);
        else if ((answered = part->two.setup(m->instance, fmi2False, 0.0, c->start, c->stops, c->stop)) <= fmi2Warning) answered = part->two.enter(m->instance);
        if (done(c, k, answered, "entering initialisation") || pass_values(c, 1, k)) return fmi2Error;
    }
    feed_from(c, 0);
    for (int64_t k = 0; k < c->n_rests; k++) {
        Member *m = &c->run.members[c->rests[k].member];
        if ((k == 0 || c->rests[k].member != c->rests[k - 1].member) && get_outputs(&c->run, m, 0, m->outputs))
            return done(c, c->rests[k].member, c->run.status, "reading its outputs at rest");
    }
    for (int64_t k = 0; k < c->n_rests; k++) c->run.bus[c->rests[k].slot] = c->run.bus[c->rests[k].source];
    if (consistent(c)) return fmi2Error;
    for (int64_t k = 0; k < c->run.count; k++) {
        void *instance = c->run.members[k].instance;
        if (done(c, k, c->run.members[k].fmi == 3 ? (int)c->parts[k].three.leave(instance) : (int)c->parts[k].two.leave(instance), "initialising")) return fmi2Error;
    }
    feed_from(c, 1);
    for (int64_t k = 0; k < c->run.count; k++)
        if (get_outputs(&c->run, &c->run.members[k], 0, c->run.members[k].outputs)) return done(c, k, c->run.status, "reading its outputs at the start");
    if (consistent(c)) return fmi2Error;
    feed_from(c, 2);
    if (consistent(c)) return fmi2Error;
    return c->stale = 0, fmi2OK;
}

static fmi2Status settle(Container *c) {
    if (c->broken) return REFUSE(c, "after an error it may only be reset or freed");
    return c->stale ? begin(c) : fmi2OK;
}

/* ---- the steps */

static fmi2Status failed(Container *c, int outcome) {
    Member *m = &c->run.members[c->run.member];
    Part *part = &c->parts[c->run.member];
    double end = c->time + c->size;
    if (outcome == NOT_FINITE) return FAIL(c, "%s: an output is not finite at %.6g s", part->name, end);
    if (outcome == SETTING) return done(c, c->run.member, c->run.status, "setting its inputs");
    if (outcome == READING) return done(c, c->run.member, c->run.status, "reading its outputs");
    fmi2Boolean ended = m->fmi == 3 && part->ended;
    if (m->fmi == 2 && c->run.status == fmi2Discard) part->two.boolean_status(m->instance, fmi2Terminated, &ended);
    c->broken = 1;
    if (ended) {
        say(c, fmi2Discard, "%s: asked to end the simulation at %.6g s", part->name, c->time);
        return c->terminated = 1, fmi2Discard;
    }
    if (m->fmi == 3 && part->early) return FAIL(c, "%s: returned early at %g s, which was not allowed", part->name, part->reached);
    say(c, fmi2Error, "%s: %s in the step from %.6g s to %.6g s", part->name, answer(c->run.status), c->time, end);
    if (c->run.status == fmi2Fatal) m->instance = NULL; /* nothing more may be called */
    return c->run.status == fmi2Fatal ? fmi2Fatal : fmi2Error;
}

static fmi2Status take(Container *c, double time, double step) {
    double here = c->start + c->step * (double)c->point;
    double count = floor(step / c->step + 0.5);
    if (fabs(time - here) > SAME * c->step) return REFUSE(c, "a step from %.9g s, and it is at %.9g s", time, here);
    if (!(count >= 1.0) || fabs(step - count * c->step) > SAME * c->step)
        return REFUSE(c, "a communication step of %.9g s is no whole multiple of its own, %.9g s", step, c->step);
    fegetenv(&c->floats);
    for (int64_t k = 0; k < (int64_t)count; k++) {
        c->time = c->start + c->step * (double)c->point, c->size = c->step;
        c->run.point = 0;
        int outcome = one_step(&c->run);
        if (outcome != FINISHED) return failed(c, outcome);
        c->point++;
    }
    return fmi2OK;
}

/* ---- values */

static fmi2Status get_values(Container *c, const fmi2ValueReference *references, size_t n, Kind kind, double *out) {
    for (size_t k = 0; k < n; k++) {
        if (references[k] >= c->n_values) return REFUSE(c, "there is no variable with value reference %u", (unsigned)references[k]);
        Value *v = &c->values[references[k]];
        if (v->kind != kind && !(v->kind == KIND_SLOT && kind == KIND_REAL)) return REFUSE(c, "the variable with value reference %u is of another type", (unsigned)references[k]);
        if (v->kind == KIND_SLOT && settle(c)) return fmi2Error;
        out[k] = v->kind == KIND_SLOT ? c->run.bus[v->member] : v->number;
    }
    return fmi2OK;
}

static fmi2Status set_value(Container *c, fmi2ValueReference reference, Kind kind, double number) {
    if (reference >= c->n_values || c->values[reference].kind == KIND_SLOT) return REFUSE(c, "there is no parameter with value reference %u", (unsigned)reference);
    Value *v = &c->values[reference];
    if (v->kind != kind) return REFUSE(c, "the parameter with value reference %u is of another type", (unsigned)reference);
    if (c->running) return REFUSE(c, "parameters can only be set before the run");
    if (v->set && v->number == number) return fmi2OK;
    v->number = number, v->set = c->stale = 1;
    return fmi2OK;
}

/* ---- FMI 2.0 */

static void close_container(Container *c) {
    release(c);
    for (int64_t k = 0; c->parts && k < c->run.count; k++) {
        if (c->parts[k].handle) close_library(c->parts[k].handle);
        free(c->parts[k].references), free(c->parts[k].sources), free(c->parts[k].links);
    }
    free(c->parts), free(c->run.members), free(c->run.bus), free(c->run.rows), free(c->rests), free(c->values), free(c->first);
    free(c->plan), free(c->name), free(c->resources), free(c);
}

static char *copy(const char *text) {
    char *own = calloc(1, strlen(text ? text : "") + 1);
    return own ? strcpy(own, text ? text : "") : NULL;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions *callbacks,
                              fmi2Boolean visible, fmi2Boolean logging) {
    Container *c = calloc(1, sizeof *c);
    if (!c) return NULL;
    c->logger = callbacks ? callbacks->logger : NULL, c->environment = callbacks ? callbacks->componentEnvironment : NULL;
    c->loud = logging, c->stale = 1, c->point = -1, c->name = copy(name), c->resources = copy(resources);
    fegetenv(&c->floats);
    int good = c->name && c->resources;
    if (good && type != fmi2CoSimulation) say(c, fmi2Error, "only co-simulation is offered"), good = 0;
    if (good && !path_of(c->resources, c->folder)) say(c, fmi2Error, "the host passes no folder of resources, which hold its FMUs"), good = 0;
    if (good && !read_plan(c, guid)) say(c, fmi2Error, "its plan cannot be followed; export the landing anew"), good = 0;
    if (good && open_members(c)) return c;
    return close_container(c), NULL;
}

void fmi2FreeInstance(fmi2Component p) {
    if (p) close_container(p);
}

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }
fmi2Status fmi2SetDebugLogging(fmi2Component p, fmi2Boolean on, size_t n, const fmi2String categories[]) { return ((Container *)p)->loud = on, fmi2OK; }

fmi2Status fmi2SetupExperiment(fmi2Component p, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start, fmi2Boolean stops, fmi2Real stop) {
    Container *c = p;
    if (c->running) return REFUSE(c, "a running instance is initialised; reset it first");
    if (!isfinite(start)) return REFUSE(c, "the start time is %g s", start);
    if (c->start != start || c->stops != stops || c->stop != stop) c->stale = 1;
    return c->start = start, c->stops = stops, c->stop = stop, fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component p) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component p) {
    Container *c = p;
    if (c->running) return REFUSE(c, "it is running already");
    fmi2Status status = settle(c);
    return c->running = status == fmi2OK, status;
}

fmi2Status fmi2Terminate(fmi2Component p) {
    Container *c = p;
    for (int64_t k = 0; k < c->run.count && c->open && !c->broken && c->running; k++) {
        void *instance = c->run.members[k].instance;
        int status = c->run.members[k].fmi == 3 ? (int)c->parts[k].three.terminate(instance) : (int)c->parts[k].two.terminate(instance);
        if (done(c, k, status, "ending the run")) return fmi2Error;
    }
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component p) {
    Container *c = p;
    release(c);
    memcpy(c->values, c->first, (size_t)c->n_values * sizeof(Value));
    c->running = c->broken = c->terminated = 0, c->stale = 1, c->point = -1, c->start = c->stop = 0.0, c->stops = 0;
    fegetenv(&c->floats);
    return open_members(c) ? fmi2OK : (c->broken = 1, fmi2Error);
}

#define ACCESS(word, type, kind) \
    fmi2Status fmi2Get##word(fmi2Component p, const fmi2ValueReference r[], size_t n, type out[]) { \
        fmi2Status status = fmi2OK; \
        for (size_t k = 0; k < n && status == fmi2OK; k++) { \
            double found = 0; \
            status = get_values(p, r + k, 1, kind, &found); \
            out[k] = (type)found; \
        } \
        return status; \
    } \
    fmi2Status fmi2Set##word(fmi2Component p, const fmi2ValueReference r[], size_t n, const type in[]) { \
        fmi2Status status = fmi2OK; \
        for (size_t k = 0; k < n && status == fmi2OK; k++) status = set_value(p, r[k], kind, (double)in[k]); \
        return status; \
    }
ACCESS(Real, fmi2Real, KIND_REAL)
ACCESS(Integer, fmi2Integer, KIND_INTEGER)
ACCESS(Boolean, fmi2Boolean, KIND_BOOLEAN)

fmi2Status fmi2GetString(fmi2Component p, const fmi2ValueReference r[], size_t n, fmi2String out[]) { return n ? REFUSE((Container *)p, "there are no texts") : fmi2OK; }
fmi2Status fmi2SetString(fmi2Component p, const fmi2ValueReference r[], size_t n, const fmi2String in[]) { return n ? REFUSE((Container *)p, "there are no texts") : fmi2OK; }

fmi2Status fmi2DoStep(fmi2Component p, fmi2Real time, fmi2Real step, fmi2Boolean final) {
    Container *c = p;
    if (c->broken) return REFUSE(c, "after an error it may only be reset or freed");
    return c->running ? take(c, time, step) : REFUSE(c, "a step before the end of the initialisation");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component p, const fmi2StatusKind kind, fmi2Boolean *out) {
    if (kind != fmi2Terminated) return fmi2Discard;
    return *out = ((Container *)p)->terminated, fmi2OK;
}
fmi2Status fmi2GetRealStatus(fmi2Component p, const fmi2StatusKind kind, fmi2Real *out) {
    Container *c = p;
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    return *out = c->start + c->step * (double)(c->point > 0 ? c->point : 0), fmi2OK;
}
fmi2Status fmi2GetStatus(fmi2Component p, const fmi2StatusKind kind, fmi2Status *out) { return fmi2Discard; }
fmi2Status fmi2GetIntegerStatus(fmi2Component p, const fmi2StatusKind kind, fmi2Integer *out) { return fmi2Discard; }
fmi2Status fmi2GetStringStatus(fmi2Component p, const fmi2StatusKind kind, fmi2String *out) { return fmi2Discard; }

#define NOT_OFFERED(what) return REFUSE((Container *)p, what " not offered")
fmi2Status fmi2CancelStep(fmi2Component p) { NOT_OFFERED("steps are synchronous; cancelling one is"); }
fmi2Status fmi2GetFMUstate(fmi2Component p, fmi2FMUstate *state) { NOT_OFFERED("saved states are"); }
fmi2Status fmi2SetFMUstate(fmi2Component p, fmi2FMUstate state) { NOT_OFFERED("saved states are"); }
fmi2Status fmi2FreeFMUstate(fmi2Component p, fmi2FMUstate *state) { NOT_OFFERED("saved states are"); }
fmi2Status fmi2SerializedFMUstateSize(fmi2Component p, fmi2FMUstate state, size_t *size) { NOT_OFFERED("saved states are"); }
fmi2Status fmi2SerializeFMUstate(fmi2Component p, fmi2FMUstate state, fmi2Byte out[], size_t size) { NOT_OFFERED("saved states are"); }
fmi2Status fmi2DeSerializeFMUstate(fmi2Component p, const fmi2Byte in[], size_t size, fmi2FMUstate *state) { NOT_OFFERED("saved states are"); }
fmi2Status fmi2GetDirectionalDerivative(fmi2Component p, const fmi2ValueReference u[], size_t n, const fmi2ValueReference k[], size_t m, const fmi2Real seed[], fmi2Real out[]) { NOT_OFFERED("derivatives are"); }
fmi2Status fmi2SetRealInputDerivatives(fmi2Component p, const fmi2ValueReference r[], size_t n, const fmi2Integer order[], const fmi2Real in[]) { NOT_OFFERED("derivatives are"); }
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component p, const fmi2ValueReference r[], size_t n, const fmi2Integer order[], fmi2Real out[]) { NOT_OFFERED("derivatives are"); }
