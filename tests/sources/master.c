/* A host without Python: FMUs of FMI 2.0 and 3.0, all taking their steps at once (Jacobi). Its task on stdin, a command a line:

       fmu NAME VERSION LIBRARY GUID RESOURCES
       set NAME REFERENCE VALUE            a number, before the initialisation
       choose NAME REFERENCE ITEM          of an enumeration
       connect NAME REFERENCE NAME REFERENCE        from an output to an input; at first those whose values are known
       watch NAME REFERENCE
       run STEP COUNT

   Prints a row of watched values for each step, and what the FMUs log. Ends with 3 where a call fails, always by itself. */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MOST = 4096 };

typedef struct {
    char name[64];
    int version;
    void *library, *instance;
} Fmu;
typedef struct {
    Fmu *from, *to;
    unsigned out, in;
} Connection;

static Fmu fmus[8];
static Connection connections[MOST], watched[64];
static int n_fmus, n_connections, n_watched;

static void log2_(void *environment, const char *instance, int status, const char *category, const char *form, ...) {
    va_list rest;
    va_start(rest, form);
    printf("%s says (status %d): ", instance, status), vprintf(form, rest), printf("\n");
    va_end(rest);
}
static void log3(void *environment, int status, const char *category, const char *text) {
    printf("%s says (status %d): %s\n", (const char *)environment, status, text);
}
static struct { void *logger, *rest[4]; } callbacks = {(void *)log2_};

static int end(const char *what, const char *name, int status) {
    printf("%s of %s failed with status %d; the host goes on\n", what, name, status);
    for (int k = 0; k < n_fmus; k++)
        if (fmus[k].instance) ((void (*)(void *))dlsym(fmus[k].library, fmus[k].version == 2 ? "fmi2FreeInstance" : "fmi3FreeInstance"))(fmus[k].instance);
    exit(3);
}

static void *function(Fmu *f, const char *two, const char *three) {
    void *found = dlsym(f->library, f->version == 2 ? two : three);
    return found ? found : (end(two, f->name, -1), NULL);
}
#define CALL(f, two, three, types2, arguments2, types3, arguments3) do { \
        void *called = function(f, "fmi2" two, "fmi3" three); \
        int status = (f)->version == 2 ? ((int (*) types2)called) arguments2 : ((int (*) types3)called) arguments3; \
        if (status > 1) end(two, (f)->name, status); \
    } while (0)

static Fmu *named(const char *name) {
    for (int k = 0; k < n_fmus; k++) if (!strcmp(fmus[k].name, name)) return &fmus[k];
    return end("looking for", name, -1), NULL;
}

static void open_fmu(const char *name, int version, const char *path, const char *guid, const char *resources) {
    Fmu *f = &fmus[n_fmus++];
    strncpy(f->name, name, sizeof f->name - 1), f->version = version;
    if (!(f->library = dlopen(path, RTLD_NOW | RTLD_LOCAL))) printf("%s\n", dlerror()), end("loading", name, -1);
    void *make = function(f, "fmi2Instantiate", "fmi3InstantiateCoSimulation");
    if (version == 2)
        f->instance = ((void *(*)(const char *, int, const char *, const char *, void *, int, int))make)(f->name, 1, guid, resources, &callbacks, 0, 1);
    else
        f->instance = ((void *(*)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t, void *, void *, void *))make)(
            f->name, guid, resources, false, true, false, false, NULL, 0, f->name, (void *)log3, NULL);
    if (!f->instance) end("instantiation", name, -1);
}

static void set(Fmu *f, unsigned reference, double value) {
    CALL(f, "SetReal", "SetFloat64", (void *, const unsigned *, size_t, const double *), (f->instance, &reference, 1, &value),
         (void *, const unsigned *, size_t, const double *, size_t), (f->instance, &reference, 1, &value, 1));
}
static double get(Fmu *f, unsigned reference) {
    double value;
    CALL(f, "GetReal", "GetFloat64", (void *, const unsigned *, size_t, double *), (f->instance, &reference, 1, &value),
         (void *, const unsigned *, size_t, double *, size_t), (f->instance, &reference, 1, &value, 1));
    return value;
}
static void choose(Fmu *f, unsigned reference, int item) {
    int64_t wide = item;
    CALL(f, "SetInteger", "SetInt64", (void *, const unsigned *, size_t, const int *), (f->instance, &reference, 1, &item),
         (void *, const unsigned *, size_t, const int64_t *, size_t), (f->instance, &reference, 1, &wide, 1));
}
/* All values first, then all are set: what one FMU gets does not depend on the order. */
static void exchange(void) {
    static double values[MOST];
    for (int k = 0; k < n_connections; k++) values[k] = get(connections[k].from, connections[k].out);
    for (int k = 0; k < n_connections; k++) set(connections[k].to, connections[k].in, values[k]);
}
static void settle(void) {
    for (int sweep = 0; sweep < 4; sweep++)
        for (int k = 0; k < n_connections; k++) set(connections[k].to, connections[k].in, get(connections[k].from, connections[k].out));
}

static void run(double step, int count) {
    for (int k = 0; k < n_fmus; k++) {
        Fmu *f = &fmus[k];
        if (f->version == 2)
            CALL(f, "SetupExperiment", "", (void *, int, double, double, int, double), (f->instance, 0, 0.0, 0.0, 0, 0.0), (void *), (f->instance));
        CALL(f, "EnterInitializationMode", "EnterInitializationMode", (void *), (f->instance), (void *, bool, double, double, bool, double),
             (f->instance, false, 0.0, 0.0, false, 0.0));
    }
    settle();
    for (int k = 0; k < n_fmus; k++) {
        Fmu *f = &fmus[k];
        CALL(f, "ExitInitializationMode", "ExitInitializationMode", (void *), (f->instance), (void *), (f->instance));
    }
    settle();
    for (int at = 0; at < count; at++) {
        for (int k = 0; k < n_fmus; k++) {
            Fmu *f = &fmus[k];
            bool event = false, over = false, early = false;
            double reached;
            CALL(f, "DoStep", "DoStep", (void *, double, double, int), (f->instance, at * step, step, 1),
                 (void *, double, double, bool, bool *, bool *, bool *, double *), (f->instance, at * step, step, true, &event, &over, &early, &reached));
        }
        for (int k = 0; k < n_watched; k++) printf("%.17g%c", get(watched[k].from, watched[k].out), k + 1 < n_watched ? ' ' : '\n');
        exchange();
    }
    for (int k = 0; k < n_fmus; k++) {
        Fmu *f = &fmus[k];
        CALL(f, "Terminate", "Terminate", (void *), (f->instance), (void *), (f->instance));
    }
}

int main(void) {
    char line[8192], one[4096], two[4096], guid[128], resources[4096];
    unsigned a, b;
    int count;
    double x;
    while (fgets(line, sizeof line, stdin)) {
        if (sscanf(line, "fmu %63s %d %4095s %127s %4095s", one, &count, two, guid, resources) == 5) open_fmu(one, count, two, guid, resources);
        else if (sscanf(line, "set %63s %u %lf", one, &a, &x) == 3) set(named(one), a, x);
        else if (sscanf(line, "choose %63s %u %d", one, &a, &count) == 3) choose(named(one), a, count);
        else if (sscanf(line, "connect %63s %u %63s %u", one, &a, two, &b) == 4) connections[n_connections++] = (Connection){named(one), named(two), a, b};
        else if (sscanf(line, "watch %63s %u", one, &a) == 2) watched[n_watched++] = (Connection){named(one), NULL, a, 0};
        else if (sscanf(line, "run %lf %d", &x, &count) == 2) run(x, count);
        else return printf("what is: %s", line), 2;
    }
    return 0;
}
