/* A compiled device and one instance of it, as the two faces (fmi2.c, fmi3.c) see them.

   The device's functions are compiled from device.py; the table `model` is written by the build from interface.py. Every instance owns its
   memory; nothing is shared but constants. The functions return a Status with the numbers of FMI 2.0 and 3.0, which are the same. */

#ifndef DEVICE_H
#define DEVICE_H

#include <stddef.h>
#include <stdint.h>

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status;
typedef enum { INPUT, OUTPUT, PARAMETER, LOCAL } Causality;
typedef enum { REAL, ENUMERATION } Type;

typedef struct {
    const char *name, *unit;
    double start, low, high;
    unsigned char causality, type;
} Variable;

/* What a function of the device works on. `seed` and `result` have the layout of `values`. */
typedef struct {
    double *values;
    void *state;
    const void *constants;
    double *seed, *result;
    double time, step;
} Call;

/* An error that a function raised; numba's layout, with a line of text in it (compile.py). */
typedef struct {
    const char *text;
    int32_t size;
} Raised;

/* `code` is what the function returned: 0, or a position in `reasons`. The result is not 0 where it raised an error. */
typedef int Function(const Call *call, int64_t *code, const Raised **raised);

/* The functions compiled for one level of the x86-64 processors. NULL: the device has none. */
typedef struct {
    const char *cpu;
    Function *initialise, *step, *refresh, *reveal, *restored, *differentiate;
} Code;

/* Why a function stopped: text with at most one number of the state in it, `before` 1.23 `after`. */
typedef struct {
    const char *format; /* of printf, with one double, where `offset` is not -1 */
    long offset;        /* of that double in the state */
} Reason;

typedef struct {
    const char *name, *guid;
    const Variable *variables;
    const Reason *reasons;
    const Code *codes; /* by rising level */
    const void *constants, *first_state;
    size_t n_variables, n_reasons, n_codes, constants_size, state_size, saved_size;
    int constants_in_resources; /* read from resources/constants.bin, not from the library */
    int (*attach)(const char *folder, char *why, size_t size); /* of a device with functions in C: given the resources; 0: it cannot run */
} Model;

int device_attach(const char *folder, char *why, size_t size);

extern const Model model; /* written by the build */

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef struct Instance Instance;
typedef void Say(Instance *, Status, const char *text);
struct Instance {
    Call call;
    const Code *code;
    const char *guid; /* the model's, or that of the constants read from the resources */
    int stale, running, broken;
    double now;
    char *name;
    void *blocks[2];
    Say *say;
    void *environment; /* of the face: how its host is told */
    void *logger;
};

Instance *device_open(const char *name, const char *guid, const char *resources, Say *say, void *environment, void *logger);
void device_close(Instance *);
Status device_refuse(Instance *, const char *form, ...);

Status device_start(Instance *, double time);
Status device_begin(Instance *);
Status device_step(Instance *, double time, double step);
void device_reset(Instance *);

/* `count` variables of one type, all references checked before any value is written. */
Status device_check(Instance *, const uint32_t *references, size_t count, Type type, int writing);
Status device_ready(Instance *, const uint32_t *references, size_t count);
void device_write(Instance *, uint32_t reference, double value);
Status device_get(Instance *, const uint32_t *references, size_t count, double *out);
Status device_set(Instance *, const uint32_t *references, size_t count, const double *in);
Status device_differentiate(Instance *, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns, size_t n_knowns, const double *seed,
                            double *sensitivity);

/* The level of the processor whose code the instance runs, such as x86-64-v3. */
EXPORT const char *sprain_cosim_cpu(void *instance);

size_t device_state_size(void);
Status device_save(Instance *, void **state);
Status device_restore(Instance *, const void *state);
Status device_state_from_bytes(Instance *, const void *bytes, size_t size, void **state);
Status device_state_to_bytes(Instance *, const void *state, void *bytes, size_t size);

#endif
