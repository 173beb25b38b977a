/* One instance of a compiled device: its memory, the order of the calls, checks, saved states (device.h). */

#include "device.h"

#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
#include <wchar.h>
/* windows.h has names of its own for INPUT, OUT and others */
__declspec(dllimport) int __stdcall MultiByteToWideChar(unsigned, unsigned long, const char *, int, wchar_t *, int);
enum { CP_UTF8 = 65001 };
#endif

enum { ALIGNMENT = 64, GUID_LENGTH = 64, TEXT = 1024, PATH = 4096 };

static const char STATE_MAGIC[8] = "SPRAINS1", TABLE_MAGIC[8] = "SPRAINC1";

typedef struct {
    char magic[8], guid[GUID_LENGTH];
    uint64_t saved_size, n_values;
    int32_t stale, running;
    double now;
} Saved; /* followed by the values and the saved part of the state */

Status device_refuse(Instance *m, const char *form, ...) {
    char text[TEXT];
    va_list rest;
    va_start(rest, form);
    vsnprintf(text, sizeof text, form, rest);
    va_end(rest);
    m->say(m, ERROR, text);
    return ERROR;
}

/* ---- the level of the processor */

static int runs_here(const char *cpu) {
#if defined(__x86_64__)
    __builtin_cpu_init();
    if (!strcmp(cpu, "x86-64-v2")) return __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt");
    if (!strcmp(cpu, "x86-64-v3"))
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
#endif
    return 1;
}

static const Code *choose(Instance *m) {
    const char *asked = getenv("SPRAIN_CPU");
    if (asked && *asked) {
        for (size_t k = 0; k < model.n_codes; k++)
            if (!strcmp(asked, model.codes[k].cpu)) {
                if (runs_here(asked)) return &model.codes[k];
                return device_refuse(m, "%s: this processor cannot run code for %s, which SPRAIN_CPU names", model.name, asked), NULL;
            }
        char known[TEXT / 2] = "";
        for (size_t k = 0; k < model.n_codes; k++) {
            size_t used = strlen(known);
            snprintf(known + used, sizeof known - used, "%s%s", k ? ", " : "", model.codes[k].cpu);
        }
        return device_refuse(m, "%s: SPRAIN_CPU is %s; this FMU is compiled for %s", model.name, asked, known), NULL;
    }
    for (size_t k = model.n_codes; k-- > 0;)
        if (runs_here(model.codes[k].cpu)) return &model.codes[k];
    return device_refuse(m, "%s: this processor is older than %s, for which the FMU is compiled", model.name, model.codes[0].cpu), NULL;
}

/* ---- constants from the FMU's resources */

/* The path of `name` in the folder that the host passed: a path, or a file URI. */
static int path_of(const char *folder, const char *name, char *out) {
    size_t n = 0;
    int uri = !strncmp(folder, "file:", 5);
    if (uri) {
        folder += 5;
        if (!strncmp(folder, "//", 2)) {
            folder += 2;
            while (*folder && *folder != '/') folder++; /* the name of the machine */
        }
#ifdef _WIN32
        if (folder[0] == '/' && folder[1] && folder[2] == ':') folder++;
#endif
    }
    for (; *folder; folder++) {
        unsigned code;
        if (n + strlen(name) + 3 > PATH) return 0;
        if (uri && *folder == '%' && sscanf(folder + 1, "%2x", &code) == 1) out[n++] = (char)code, folder += 2;
        else out[n++] = *folder;
    }
    if (n && out[n - 1] != '/' && out[n - 1] != '\\') out[n++] = '/';
    strcpy(out + n, name);
    return 1;
}

static FILE *open_binary(const char *path) {
#ifdef _WIN32
    wchar_t wide[PATH];
    if (!MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, PATH)) return NULL;
    return _wfopen(wide, L"rb");
#else
    return fopen(path, "rb");
#endif
}

static int read_constants(Instance *m, const char *resources, char *guid, void *out) {
    struct {
        char magic[8], guid[GUID_LENGTH];
        uint64_t size;
    } head;
    char path[PATH];
    if (!resources || !path_of(resources, "constants.bin", path))
        return device_refuse(m, "%s: the host passes no folder of resources, which hold its table", model.name), 0;
    FILE *file = open_binary(path);
    if (!file) return device_refuse(m, "%s: %s cannot be read: %s", model.name, path, strerror(errno)), 0;
    int good = fread(&head, sizeof head, 1, file) == 1 && !memcmp(head.magic, TABLE_MAGIC, sizeof head.magic) &&
               head.size == model.constants_size && fread(out, model.constants_size, 1, file) == 1 && fgetc(file) == EOF;
    fclose(file);
    if (!good) return device_refuse(m, "%s: %s is not a table of this model", model.name, path), 0;
    memcpy(guid, head.guid, GUID_LENGTH);
    return 1;
}

/* ---- one instance */

static void *aligned(void **block, size_t size) {
    if (!(*block = calloc(1, size + ALIGNMENT))) return NULL;
    return (void *)(((uintptr_t)*block + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT);
}

static size_t rounded(size_t size) { return (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT; }

static int prepare(Instance *m, const char *guid, const char *resources) {
    size_t values = rounded(model.n_variables * sizeof(double)), state = rounded(model.state_size);
    char *memory = aligned(&m->blocks[0], 3 * values + state);
    if (!memory) return device_refuse(m, "%s: out of memory", model.name), 0;
    m->call = (Call){(double *)memory, memory + 3 * values, model.constants, (double *)(memory + values), (double *)(memory + 2 * values), 0.0, 0.0};
    m->guid = model.guid;
    if (model.constants_in_resources) {
        char *table = aligned(&m->blocks[1], rounded(model.constants_size) + GUID_LENGTH + 1);
        if (!table) return device_refuse(m, "%s: out of memory", model.name), 0;
        char *own = table + rounded(model.constants_size);
        if (!read_constants(m, resources, own, table)) return 0;
        m->call.constants = table, m->guid = own;
    }
    if (model.attach) {
        char folder[PATH], why[TEXT / 2] = "the host passes no folder of resources";
        if (!resources || !path_of(resources, "", folder) || !model.attach(folder, why, sizeof why))
            return device_refuse(m, "%s: %s", model.name, why), 0;
    }
    if (guid && strcmp(guid, m->guid))
        return device_refuse(m, "%s: the GUID %.80s is not that of this library, %s; unpack the FMU again", model.name, guid, m->guid), 0;
    return (m->code = choose(m)) != NULL;
}

Instance *device_open(const char *name, const char *guid, const char *resources, Say *say, void *environment, void *logger) {
    Instance *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->say = say, m->environment = environment, m->logger = logger;
    size_t length = strlen(name ? name : "");
    m->name = calloc(1, length + 1);
    if (!m->name || !(memcpy(m->name, name ? name : "", length), prepare(m, guid, resources))) return device_close(m), NULL;
    device_reset(m);
    return m;
}

void device_close(Instance *m) {
    if (!m) return;
    free(m->blocks[0]), free(m->blocks[1]), free(m->name), free(m);
}

void device_reset(Instance *m) {
    for (size_t k = 0; k < model.n_variables; k++) m->call.values[k] = model.variables[k].start;
    if (model.first_state) memcpy(m->call.state, model.first_state, model.state_size);
    else memset(m->call.state, 0, model.state_size);
    m->stale = 1, m->running = m->broken = 0, m->now = 0.0;
}

const char *sprain_cosim_cpu(void *instance) { return ((Instance *)instance)->code->cpu; }

/* ---- calls of the device's functions */

static Status call(Instance *m, Function *function, double time, double step) {
    int64_t code = 0;
    if (!function) return OK;
    m->call.time = time, m->call.step = step;
    const Raised *raised = NULL;
    int failed = function(&m->call, &code, &raised);
    if (!failed && code == 0) return OK;
    m->broken = 1;
    if (failed)
        return device_refuse(m, "%s: at %g s %.*s", model.name, time + step, raised ? (int)raised->size : 8, raised ? raised->text : "an error");
    if (code < 0 || (size_t)code >= model.n_reasons)
        return device_refuse(m, "%s: at %g s a function returned %lld, which stands for no reason", model.name, time + step, (long long)code);
    Reason reason = model.reasons[code];
    if (reason.offset < 0) return device_refuse(m, "%s: %s", model.name, reason.format);
    char text[TEXT];
    snprintf(text, sizeof text, reason.format, *(double *)((char *)m->call.state + reason.offset));
    return device_refuse(m, "%s: %s", model.name, text);
}

/* Every parameter that is out of its range, in one message. */
static Status parameters_fit(Instance *m) {
    char text[TEXT] = "";
    for (size_t k = 0; k < model.n_variables; k++) {
        const Variable *v = &model.variables[k];
        double value = m->call.values[k];
        if (v->causality != PARAMETER || (v->low <= value && value <= v->high)) continue;
        size_t used = strlen(text);
        const char *unit = strcmp(v->unit, "1") ? v->unit : "";
        snprintf(text + used, sizeof text - used, "%s%s = %g%s%s: must lie between %g and %g", used ? "; " : "", v->name, value, *unit ? " " : "", unit,
                 v->low, v->high);
    }
    return *text ? device_refuse(m, "%s", text) : OK;
}

/* Outputs follow what was set since they were computed. */
static Status settle(Instance *m) {
    if (m->broken) return device_refuse(m, "%s: after an error the instance may only be reset or freed", model.name);
    if (!m->stale) return OK;
    Status status = m->running ? OK : parameters_fit(m);
    if (status == OK) status = call(m, m->running ? m->code->refresh : m->code->initialise, m->now, 0.0);
    if (status == OK) m->stale = 0;
    return status;
}

Status device_start(Instance *m, double time) {
    if (m->running) return device_refuse(m, "%s: a running instance is initialised; reset it first", model.name);
    if (!isfinite(time)) return device_refuse(m, "%s: the start time is %g s", model.name, time);
    if (time != m->now) m->now = time, m->stale = 1;
    return OK;
}

Status device_begin(Instance *m) {
    if (m->running) return device_refuse(m, "%s: it is running already", model.name);
    Status status = settle(m);
    if (status == OK) m->running = 1;
    return status;
}

Status device_step(Instance *m, double time, double step) {
    if (m->broken) return device_refuse(m, "%s: after an error the instance may only be reset or freed", model.name);
    if (!m->running) return device_refuse(m, "%s: a step before the end of the initialisation", model.name);
    if (!(step >= 0.0) || !isfinite(time + step)) return device_refuse(m, "%s: a step from %g s over %g s", model.name, time, step);
    Status status = call(m, m->code->step, time, step);
    if (status == OK) m->stale = 0, m->now = time + step;
    return status;
}

/* ---- values */

Status device_check(Instance *m, const uint32_t *references, size_t count, Type type, int writing) {
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= model.n_variables) {
            if (references[k] == model.n_variables && !writing && type == REAL) continue; /* the time */
            return device_refuse(m, "%s: there is no variable with value reference %u", model.name, (unsigned)references[k]);
        }
        const Variable *v = &model.variables[references[k]];
        if (v->type != type) return device_refuse(m, "%s: %s is %s", model.name, v->name, v->type == REAL ? "a real number" : "an enumeration");
        if (!writing) continue;
        if (v->causality == OUTPUT || v->causality == LOCAL) return device_refuse(m, "%s: %s is computed, it cannot be set", model.name, v->name);
        if (v->causality == PARAMETER && m->running)
            return device_refuse(m, "%s: parameter %s can only be set before initialisation", model.name, v->name);
    }
    return OK;
}

Status device_ready(Instance *m, const uint32_t *references, size_t count) {
    Status status = settle(m);
    for (size_t k = 0; k < count && status == OK; k++)
        if (references[k] < model.n_variables && model.variables[references[k]].causality == LOCAL) return call(m, m->code->reveal, m->now, 0.0);
    return status;
}

/* Before the run a value that does not change asks for nothing; during a run setting an input is an event even then. */
void device_write(Instance *m, uint32_t reference, double value) {
    double *place = &m->call.values[reference];
    if (m->running || !(*place == value)) m->stale = 1;
    *place = value;
}

Status device_get(Instance *m, const uint32_t *references, size_t count, double *out) {
    Status status = device_check(m, references, count, REAL, 0);
    if (status == OK) status = device_ready(m, references, count);
    for (size_t k = 0; k < count && status == OK; k++) out[k] = references[k] < model.n_variables ? m->call.values[references[k]] : m->now;
    return status;
}

Status device_set(Instance *m, const uint32_t *references, size_t count, const double *in) {
    Status status = device_check(m, references, count, REAL, 1);
    for (size_t k = 0; k < count && status == OK; k++) device_write(m, references[k], in[k]);
    return status;
}

Status device_differentiate(Instance *m, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns, size_t n_knowns, const double *seed,
                            double *sensitivity) {
    if (!m->code->differentiate) return device_refuse(m, "%s: directional derivatives are not provided", model.name);
    for (size_t k = 0; k < n_unknowns; k++)
        if (unknowns[k] >= model.n_variables || model.variables[unknowns[k]].causality != OUTPUT)
            return device_refuse(m, "%s: value reference %u is no output, so it has no derivative", model.name, (unsigned)unknowns[k]);
    for (size_t k = 0; k < n_knowns; k++)
        if (knowns[k] >= model.n_variables || model.variables[knowns[k]].causality != INPUT)
            return device_refuse(m, "%s: value reference %u is no input; derivatives are those over inputs", model.name, (unsigned)knowns[k]);
    Status status = settle(m);
    if (status != OK) return status;
    memset(m->call.seed, 0, model.n_variables * sizeof(double)), memset(m->call.result, 0, model.n_variables * sizeof(double));
    for (size_t k = 0; k < n_knowns; k++) m->call.seed[knowns[k]] += seed[k];
    status = call(m, m->code->differentiate, m->now, 0.0);
    for (size_t k = 0; k < n_unknowns && status == OK; k++) sensitivity[k] = m->call.result[unknowns[k]];
    return status;
}

/* ---- saved states */

size_t device_state_size(void) { return sizeof(Saved) + model.n_variables * sizeof(double) + model.saved_size; }

Status device_save(Instance *m, void **state) {
    if (!*state && !(*state = malloc(device_state_size()))) return device_refuse(m, "%s: out of memory", model.name);
    Saved *saved = *state;
    memcpy(saved->magic, STATE_MAGIC, sizeof saved->magic), memcpy(saved->guid, m->guid, GUID_LENGTH);
    saved->saved_size = model.saved_size, saved->n_values = model.n_variables;
    saved->stale = m->stale, saved->running = m->running, saved->now = m->now;
    char *place = (char *)(saved + 1);
    memcpy(place, m->call.values, model.n_variables * sizeof(double));
    memcpy(place + model.n_variables * sizeof(double), m->call.state, model.saved_size);
    return OK;
}

static int is_own(Instance *m, const Saved *saved) {
    return !memcmp(saved->magic, STATE_MAGIC, sizeof saved->magic) && !memcmp(saved->guid, m->guid, GUID_LENGTH) &&
           saved->saved_size == model.saved_size && saved->n_values == model.n_variables;
}

Status device_restore(Instance *m, const void *state) {
    const Saved *saved = state;
    if (!saved) return device_refuse(m, "%s: no state to restore", model.name);
    if (!is_own(m, saved)) return device_refuse(m, "%s: this is a state of another model", model.name);
    const char *place = (const char *)(saved + 1);
    memcpy(m->call.values, place, model.n_variables * sizeof(double));
    memcpy(m->call.state, place + model.n_variables * sizeof(double), model.saved_size);
    m->stale = saved->stale, m->running = saved->running, m->now = saved->now, m->broken = 0;
    return call(m, m->code->restored, m->now, 0.0);
}

Status device_state_to_bytes(Instance *m, const void *state, void *bytes, size_t size) {
    if (!state) return device_refuse(m, "%s: no state to write", model.name);
    if (size < device_state_size()) return device_refuse(m, "%s: the state has %zu bytes, the buffer %zu", model.name, device_state_size(), size);
    memcpy(bytes, state, device_state_size());
    return OK;
}

Status device_state_from_bytes(Instance *m, const void *bytes, size_t size, void **state) {
    Saved head;
    if (size >= sizeof head) memcpy(&head, bytes, sizeof head);
    if (size != device_state_size() || !is_own(m, &head)) return device_refuse(m, "%s: these %zu bytes are no state of this model", model.name, size);
    if (!*state && !(*state = malloc(size))) return device_refuse(m, "%s: out of memory", model.name);
    memcpy(*state, bytes, size);
    return OK;
}
