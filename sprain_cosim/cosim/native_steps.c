/* Communication steps of Gauss-Seidel and Jacobi over the functions of FMI 2 and 3, and the exchange of values at one
   instant: what native_steps.py and native_members.py describe, and the same operations in the same order as
   schemes/gauss_seidel.py, schemes/jacobi.py, assembly.py and loops.py, so that a record is the same to the bit.
   container.c steps with them as well. */

#include <fenv.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <time.h>

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef uint32_t Reference;
typedef int Fmi2Access(void *, const Reference *, size_t, double *);
typedef int Fmi2Step(void *, double, double, int);
typedef int Fmi3Access(void *, const Reference *, size_t, double *, size_t);
typedef int Fmi3Step(void *, double, double, bool, bool *, bool *, bool *, double *);

enum { WARNING = 1 };                                              /* status of FMI; others need the caller */
enum { FINISHED, PAUSED, SETTING, STEPPING, READING, NOT_FINITE }; /* what `take_steps` returns */

typedef struct {
    void *instance, *set, *get, *step;
    const Reference *input_references, *output_references;
    const int64_t *sources;          /* slots of the bus that feed the inputs */
    const double *factor, *offset;   /* from the sources' units to those of the inputs */
    const fenv_t *environment;       /* of a foreign library: put back after each call; NULL for others */
    bool *event, *terminate, *early; /* FMI 3: answers of a step */
    double *reached;
    int64_t first_input, inputs, first_output, outputs;
    int64_t direct;                  /* the last so many outputs follow the inputs directly */
    int32_t fmi, scaled, fed_back, final, inputs_set;
    int32_t warnings;                /* calls so far that gave fmi2Warning */
} Member;

typedef struct {
    double *bus, *rows;              /* rows: (points + 1, slots), row k at point k */
    const double *time, *step;       /* (points) of each step [s] */
    Member *members;
    int64_t slots, count, points;
    int64_t point, member;           /* where it stands */
    int32_t stepped;                 /* the member there has taken its step; its outputs have not been read */
    int32_t status;                  /* of the call that was answered otherwise than by ok or warning */
    int32_t jacobi;                  /* all step from the same values */
} Run;

static double seconds(void) {
#ifdef _WIN32
    return (double)clock() / CLOCKS_PER_SEC; /* wall time there; its C library has no timespec_get */
#else
    struct timespec now;
    timespec_get(&now, TIME_UTC);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
#endif
}

/* Rounding to nearest, and tiny numbers kept? Volatile, so that it is tried out now. */
static bool usual(void) {
    volatile double one = 1.0, little = 0x1p-53, more = 0x1.8p-53, tiny = 0x1p-1022, half = 0.5;
    return one + little == one && one + more == 0x1.0000000000001p0 && tiny * half != 0.0;
}

static int judged(Run *run, Member *m, int status) {
    m->warnings += status == WARNING;
    run->status = status;
    return status != 0 && status != WARNING;
}

static int carry(Run *run, Member *m, void *function, const Reference *references, int64_t n, double *values) {
    int status;
    if (n == 0) return 0;
    if (m->fmi == 3)
        status = ((Fmi3Access *)function)(m->instance, references, (size_t)n, values, (size_t)n);
    else
        status = ((Fmi2Access *)function)(m->instance, references, (size_t)n, values);
    if (m->environment && !usual()) fesetenv(m->environment);
    return judged(run, m, status);
}

static int set_inputs(Run *run, Member *m) {
    return carry(run, m, m->set, m->input_references, m->inputs, run->bus + m->first_input);
}

static int get_outputs(Run *run, Member *m, int64_t first, int64_t stop) {
    return carry(run, m, m->get, m->output_references + first, stop - first, run->bus + m->first_output + first);
}

static void transfer(Run *run, Member *m) {
    double *inputs = run->bus + m->first_input;
    for (int64_t k = 0; k < m->inputs; k++) inputs[k] = run->bus[m->sources[k]];
    if (m->scaled)
        for (int64_t k = 0; k < m->inputs; k++) {
            double scaled = inputs[k] * m->factor[k];
            inputs[k] = scaled + m->offset[k];
        }
}

#ifdef _WIN32 /* what the C library of Python saved is not laid out as fesetenv of this library reads it */
static void keep_environment(Run *run, fenv_t *own) {
    fegetenv(own);
    for (int64_t k = 0; k < run->count; k++)
        if (run->members[k].environment) run->members[k].environment = own;
}
#else
static void keep_environment(Run *run, fenv_t *own) {}
#endif

/* All members take their inputs and give their outputs at one instant, as loops.py has them do until nothing changes. */
static int exchange(Run *run) {
    for (run->member = 0; run->member < run->count; run->member++) {
        Member *m = run->members + run->member;
        transfer(run, m);
        if (set_inputs(run, m)) return SETTING;
        if (get_outputs(run, m, 0, m->outputs)) return READING;
    }
    for (int64_t k = 0; k < run->count; k++) transfer(run, run->members + k);
    run->member = 0;
    return FINISHED;
}

EXPORT int exchange_values(Run *run) {
    fenv_t own;
    keep_environment(run, &own);
    return exchange(run);
}

static int do_step(Run *run, Member *m) {
    double time = run->time[run->point], step = run->step[run->point];
    int status;
    if (m->fmi == 3) {
        *m->event = *m->terminate = *m->early = false;
        *m->reached = time;
        status = ((Fmi3Step *)m->step)(m->instance, time, step, m->final != 0, m->event, m->terminate, m->early, m->reached);
    } else
        status = ((Fmi2Step *)m->step)(m->instance, time, step, m->final);
    if (m->environment) fesetenv(m->environment);
    return judged(run, m, status) || (m->fmi == 3 && (*m->terminate || *m->early));
}

static bool all_finite(const double *values, int64_t n) {
    for (int64_t k = 0; k < n; k++)
        if (!isfinite(values[k])) return false;
    return true;
}

/* The member where the run stands takes its step; whoever needs new inputs first has them on the bus. */
static int advance(Run *run, Member *m, int64_t outputs) {
    if (!run->stepped) {
        if (!m->inputs_set && set_inputs(run, m)) return SETTING;
        if (do_step(run, m)) return STEPPING;
    }
    run->stepped = 0;
    if (get_outputs(run, m, 0, outputs)) return READING;
    m->inputs_set = 0;
    return all_finite(run->bus + m->first_output, m->outputs) ? FINISHED : NOT_FINITE;
}

static int gauss_seidel(Run *run) {
    for (; run->member < run->count; run->member++) {
        Member *m = run->members + run->member;
        if (!run->stepped && !m->inputs_set) transfer(run, m);
        int outcome = advance(run, m, m->fed_back ? m->outputs - m->direct : m->outputs);
        if (outcome != FINISHED) return outcome;
    }
    for (run->member = 0; run->member < run->count; run->member++) {
        Member *m = run->members + run->member;
        if (!m->fed_back) continue;
        transfer(run, m);
        if (set_inputs(run, m)) return SETTING;
        m->inputs_set = 1;
        if (get_outputs(run, m, m->outputs - m->direct, m->outputs)) return READING;
    }
    return FINISHED;
}

static int jacobi(Run *run) {
    for (; run->member < run->count; run->member++) {
        int outcome = advance(run, run->members + run->member, run->members[run->member].outputs);
        if (outcome != FINISHED) return outcome;
    }
    for (int64_t k = 0; k < run->count; k++) transfer(run, run->members + k);
    return FINISHED;
}

/* From consistent values at the present point to those at the next. */
static int one_step(Run *run) {
    int outcome = run->jacobi ? jacobi(run) : gauss_seidel(run);
    if (outcome != FINISHED) return outcome;
    run->member = 0;
    run->point++;
    memcpy(run->rows + run->point * run->slots, run->bus, (size_t)run->slots * sizeof(double));
    return FINISHED;
}

/* Takes steps until the last point, until `limit` [s] of wall time are over, or until a call needs the caller; then
   `point`, `member` and `status` say which. */
EXPORT int take_steps(Run *run, double limit) {
    double end = seconds() + limit;
    fenv_t own;
    keep_environment(run, &own);
    while (run->point < run->points) {
        int outcome = one_step(run);
        if (outcome != FINISHED) return outcome;
        if (seconds() > end) return run->point < run->points ? PAUSED : FINISHED;
    }
    return FINISHED;
}

/* Which source this was built from. */
EXPORT const char *const source = SOURCE;
