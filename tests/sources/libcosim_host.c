/* libcosim without Python: libcosim_host LIBCOSIMC, the task of master.c on stdin (with `fmu NAME ARCHIVE`), its rows on stdout. */
#include <dlfcn.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define FUNCTION(result, name, ...) result (*name)(__VA_ARGS__) = dlsym(library, "cosim_" #name)
#define MUST(what) do { if (!(what)) return printf("%s: %s\n", #what, last_error_message()), 3; } while (0)

int main(int argc, char **argv) {
    void *library = argc == 2 ? dlopen(argv[1], RTLD_NOW) : NULL;
    if (!library) return printf("%s\n", dlerror()), 2;
    FUNCTION(const char *, last_error_message, void);
    FUNCTION(int, log_set_output_level, int);
    FUNCTION(void *, execution_create, int64_t, int64_t);
    FUNCTION(void *, local_slave_create, const char *, const char *);
    FUNCTION(int, execution_add_slave, void *, void *);
    FUNCTION(int, execution_connect_real_variables, void *, int, uint32_t, int, uint32_t);
    FUNCTION(int, execution_set_real_initial_value, void *, int, uint32_t, double);
    FUNCTION(int, execution_set_integer_initial_value, void *, int, uint32_t, int);
    FUNCTION(void *, last_value_observer_create, void);
    FUNCTION(int, execution_add_observer, void *, void *);
    FUNCTION(int, execution_step, void *, size_t);
    FUNCTION(int, observer_slave_get_real, void *, int, const uint32_t *, size_t, double *);

    enum { MOST = 4096, STEP_NS = 500000 };
    static char lines[MOST][512], names[8][64];
    int n = 0, n_fmus = 0, slaves[8], count = 0;
    while (n < MOST && fgets(lines[n], sizeof *lines, stdin)) n++;
    log_set_output_level(5);
    void *execution = execution_create(0, STEP_NS), *observer = last_value_observer_create();
    MUST(execution && observer);
    struct { int slave; uint32_t reference; } watched[64];
    int n_watched = 0;
    for (int k = 0; k < n; k++) {
        char one[512], two[512];
        unsigned a, b;
        double x;
        int item;
#define SLAVE(name) ({ int at = 0; while (at < n_fmus && strcmp(names[at], name)) at++; slaves[at]; })
        if (sscanf(lines[k], "fmu %63s %511s", one, two) == 2) {
            void *slave = local_slave_create(two, one);
            MUST(slave);
            strcpy(names[n_fmus], one);
            slaves[n_fmus++] = execution_add_slave(execution, slave);
        } else if (sscanf(lines[k], "set %511s %u %lf", one, &a, &x) == 3) MUST(execution_set_real_initial_value(execution, SLAVE(one), a, x) >= 0);
        else if (sscanf(lines[k], "choose %511s %u %d", one, &a, &item) == 3) MUST(execution_set_integer_initial_value(execution, SLAVE(one), a, item) >= 0);
        else if (sscanf(lines[k], "connect %511s %u %511s %u", one, &a, two, &b) == 4)
            MUST(execution_connect_real_variables(execution, SLAVE(one), a, SLAVE(two), b) >= 0);
        else if (sscanf(lines[k], "watch %511s %u", one, &a) == 2) watched[n_watched].slave = SLAVE(one), watched[n_watched++].reference = a;
        else if (sscanf(lines[k], "run %lf %d", &x, &count) != 2) return printf("what is: %s", lines[k]), 2;
    }
    MUST(execution_add_observer(execution, observer) >= 0);
    for (int at = 0; at < count; at++) {
        MUST(execution_step(execution, 1) >= 0);
        for (int k = 0; k < n_watched; k++) {
            double value;
            MUST(observer_slave_get_real(observer, watched[k].slave, &watched[k].reference, 1, &value) >= 0);
            printf("%.17g%c", value, k + 1 < n_watched ? ' ' : '\n');
        }
    }
    return 0;
}
