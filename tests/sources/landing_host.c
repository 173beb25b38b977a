/* A host without Python, on Linux and Windows: landing_host LIBRARY GUID RESOURCES OUTPUT STEP STEPS [INPUT VALUE]... prints OUTPUT after every step. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#ifdef _WIN32
#include <windows.h>
#define OPEN(path) (void *)LoadLibraryA(path)
#define FIND(library, name) (void *)GetProcAddress(library, name)
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define FIND dlsym
#endif

static void logger(void *environment, const char *instance, int status, const char *category, const char *message, ...) {
    va_list rest;
    va_start(rest, message);
    vprintf(message, rest);
    va_end(rest);
}

#define FUNCTION(result, name, ...) result (*name)(__VA_ARGS__) = FIND(library, "fmi2" #name)

int main(int argc, char **argv) {
    struct { void (*log)(void *, const char *, int, const char *, const char *, ...); void *rest[4]; } callbacks = {logger};
    void *library = argc > 6 ? OPEN(argv[1]) : NULL;
    if (!library) return printf("%s cannot be loaded", argv[1]), 2;
    FUNCTION(void *, Instantiate, const char *, int, const char *, const char *, void *, int, int);
    FUNCTION(int, SetupExperiment, void *, int, double, double, int, double);
    FUNCTION(int, EnterInitializationMode, void *);
    FUNCTION(int, ExitInitializationMode, void *);
    FUNCTION(int, SetReal, void *, const unsigned *, size_t, const double *);
    FUNCTION(int, GetReal, void *, const unsigned *, size_t, double *);
    FUNCTION(int, DoStep, void *, double, double, int);
    FUNCTION(void, FreeInstance, void *);
    unsigned output = atoi(argv[4]);
    double step = atof(argv[5]), seen = 0.0;
    void *m = Instantiate("landing", 1, argv[2], argv[3], &callbacks, 0, 0);
    if (!m) return 3;
    int status = SetupExperiment(m, 0, 0, 0, 0, 0);
    for (int k = 7; k + 1 < argc; k += 2) {
        unsigned input = atoi(argv[k]);
        double value = atof(argv[k + 1]);
        status |= SetReal(m, &input, 1, &value);
    }
    status |= EnterInitializationMode(m) | ExitInitializationMode(m);
    for (int k = 0; k < atoi(argv[6]) && !status; k++) {
        status |= DoStep(m, k * step, step, 1) | GetReal(m, &output, 1, &seen);
        printf("%.17g\n", seen);
    }
    FreeInstance(m);
    return status;
}
