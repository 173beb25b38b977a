/* A host that is not a Python process: loads the library argv[1], instantiates it and shows what it logs. */
#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static void hear(void *environment, const char *instance, int status, const char *category, const char *message, ...) {
    va_list rest;
    va_start(rest, message);
    printf("%s, status %d: ", instance, status);
    vprintf(message, rest);
    va_end(rest);
}

int main(int argc, char **argv) {
    struct { void (*logger)(void *, const char *, int, const char *, const char *, ...); void *rest[4]; } callbacks = {hear};
    void *library = dlopen(argv[1], RTLD_NOW);
    if (!library) return printf("%s", dlerror()), 2;
    void *(*instantiate)(const char *, int, const char *, const char *, void *, int, int) = dlsym(library, "fmi2Instantiate");
    return instantiate("brace", 1, "", "file:///nowhere", &callbacks, 0, 0) != NULL;
}
