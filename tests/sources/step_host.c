/* A host without Python: step_host LIBRARY GUID INPUT OUTPUT VALUE sets the input, takes ten steps of 1 ms and prints the output. */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static void logger(void *environment, const char *instance, int status, const char *category, const char *message, ...) {
    va_list rest;
    va_start(rest, message);
    vprintf(message, rest);
    va_end(rest);
}

#define FUNCTION(result, name, ...) result (*name)(__VA_ARGS__) = dlsym(library, "fmi2" #name)

int main(int argc, char **argv) {
    struct { void (*log)(void *, const char *, int, const char *, const char *, ...); void *rest[4]; } callbacks = {logger};
    void *library = argc == 6 ? dlopen(argv[1], RTLD_NOW | RTLD_LOCAL) : NULL;
    if (!library) return printf("%s", dlerror()), 2;
    FUNCTION(void *, Instantiate, const char *, int, const char *, const char *, void *, int, int);
    FUNCTION(int, SetupExperiment, void *, int, double, double, int, double);
    FUNCTION(int, EnterInitializationMode, void *);
    FUNCTION(int, ExitInitializationMode, void *);
    FUNCTION(int, SetReal, void *, const unsigned *, size_t, const double *);
    FUNCTION(int, GetReal, void *, const unsigned *, size_t, double *);
    FUNCTION(int, DoStep, void *, double, double, int);
    FUNCTION(void, FreeInstance, void *);
    unsigned input = atoi(argv[3]), output = atoi(argv[4]);
    double value = atof(argv[5]), seen = 0.0;
    void *m = Instantiate("device", 1, argv[2], "file:///nowhere", &callbacks, 0, 0);
    if (!m) return 3;
    int status = SetupExperiment(m, 0, 0, 0, 0, 0) | SetReal(m, &input, 1, &value) | EnterInitializationMode(m) | ExitInitializationMode(m);
    for (int k = 0; k < 10; k++) status |= DoStep(m, k * 1e-3, 1e-3, 1);
    status |= GetReal(m, &output, 1, &seen);
    FreeInstance(m);
    printf("%.17g", seen);
    return status;
}
