/* The FMI 2.0 face of a Python slave (python_slave.py): values are read and written in the slave's own array, without the interpreter; only what
   computes calls into Python. The library lives inside a Python process and finds the interpreter's functions there when it is loaded, so it
   needs no Python to be compiled, and one binary serves every version. All functions used belong to Python's stable ABI. */

#include <dlfcn.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define API __attribute__((visibility("default")))

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef void (*Logger)(void *environment, const char *instance, Status status, const char *category, const char *message, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, Status);
    void *environment;
} Callbacks;

enum { PARAMETER = 1, LOCAL = 2 };
typedef void *Object;
static struct {
    int (*IsInitialized)(void);
    int (*GilEnsure)(void);
    void (*GilRelease)(int);
    Object (*Compile)(const char *, const char *, int);
    Object (*Eval)(Object, Object, Object);
    Object (*NewDict)(void);
    int (*SetItem)(Object, const char *, Object);
    Object (*GetItem)(Object, const char *);
    Object (*Builtins)(void);
    Object (*CallFunction)(Object, const char *, ...);
    Object (*CallMethod)(Object, const char *, const char *, ...);
    Object (*GetAttr)(Object, const char *);
    int (*SetAttr)(Object, const char *, Object);
    int (*IsTrue)(Object);
    Object (*FromLong)(long);
    size_t (*AsSize)(Object);
    void *(*AsPointer)(Object);
    Object (*TupleItem)(Object, ssize_t);
    int (*BytesView)(Object, char **, ssize_t *);
    Object (*BytesFrom)(const char *, ssize_t);
    void (*FetchError)(Object *, Object *, Object *);
    void (*NormalizeError)(Object *, Object *, Object *);
    Object (*Repr)(Object);
    const char *(*Text)(Object, ssize_t *);
    void (*ClearError)(void);
    void (*Drop)(Object);
} py;

static const char *const NAMES[] = {
    "Py_IsInitialized", "PyGILState_Ensure", "PyGILState_Release", "Py_CompileString", "PyEval_EvalCode", "PyDict_New", "PyDict_SetItemString",
    "PyDict_GetItemString", "PyEval_GetBuiltins", "PyObject_CallFunction", "PyObject_CallMethod", "PyObject_GetAttrString",
    "PyObject_SetAttrString", "PyObject_IsTrue", "PyLong_FromLong", "PyLong_AsSize_t", "PyLong_AsVoidPtr", "PyTuple_GetItem",
    "PyBytes_AsStringAndSize", "PyBytes_FromStringAndSize", "PyErr_Fetch", "PyErr_NormalizeException", "PyObject_Repr", "PyUnicode_AsUTF8AndSize",
    "PyErr_Clear", "Py_DecRef",
};

static int find_python(void) {
    void **slot = (void **)&py;
    for (size_t k = 0; k < sizeof NAMES / sizeof *NAMES; k++)
        if (!slot[k] && !(slot[k] = dlsym(RTLD_DEFAULT, NAMES[k]))) return 0;
    return py.IsInitialized();
}

static const char OPEN[] =
    "def open_slave(location, instance_name):\n"
    "    import importlib, pathlib, sys, urllib.parse, urllib.request\n"
    "    folder = pathlib.Path(urllib.request.url2pathname(urllib.parse.urlparse(location).path))\n"
    "    name = (folder / 'slavemodule.txt').read_text().strip()\n"
    "    if str(folder) not in sys.path:\n"
    "        sys.path.insert(0, str(folder))\n"
    "    module = importlib.import_module(name)\n"
    "    found = [c for c in vars(module).values() if isinstance(c, type) and c.__module__ == name]\n"
    "    return found[0](instance_name=instance_name, resources=str(folder))\n";

typedef struct {
    Object slave, do_step, settle;
    double *values;
    const unsigned char *kinds; /* by value reference: PARAMETER cannot change during a run, LOCAL is computed when it is asked for */
    size_t count;
    int stale, running;
    char *name;
    Callbacks callbacks;
} Instance;

static void say(Instance *m, Status status, const char *text) {
    if (m->callbacks.logger) m->callbacks.logger(m->callbacks.environment, m->name, status, "logAll", "%s", text);
}

/* What Python raised, to the log. A slave's errors carry their traceback as repr. */
static Status raised(Instance *m) {
    Object type = NULL, value = NULL, traceback = NULL;
    py.FetchError(&type, &value, &traceback);
    py.NormalizeError(&type, &value, &traceback);
    Object text = value ? py.Repr(value) : NULL;
    const char *shown = text ? py.Text(text, NULL) : NULL;
    say(m, ERROR, shown ? shown : "an error without text");
    py.ClearError();
    py.Drop(text), py.Drop(type), py.Drop(value), py.Drop(traceback);
    return ERROR;
}

static Status done(Instance *m, Object result) {
    if (!result) return raised(m);
    py.Drop(result);
    return OK;
}

static Status refuse(Instance *m, const char *form, ...) {
    char text[256];
    va_list rest;
    va_start(rest, form);
    vsnprintf(text, sizeof text, form, rest);
    va_end(rest);
    say(m, ERROR, text);
    return ERROR;
}

static void let_go(Instance *m) {
    py.Drop(m->do_step), py.Drop(m->settle), py.Drop(m->slave);
    m->do_step = m->settle = m->slave = NULL;
}

/* The slave's memory: (address of values, their number, address of their kinds). */
static int take_hold(Instance *m) {
    m->do_step = py.GetAttr(m->slave, "do_step");
    m->settle = py.GetAttr(m->slave, "settle");
    Object memory = py.CallMethod(m->slave, "memory", NULL);
    if (!m->do_step || !m->settle || !memory) {
        py.Drop(memory);
        return 0;
    }
    m->values = py.AsPointer(py.TupleItem(memory, 0));
    m->count = py.AsSize(py.TupleItem(memory, 1));
    m->kinds = py.AsPointer(py.TupleItem(memory, 2));
    py.Drop(memory);
    m->stale = 1, m->running = 0;
    return 1;
}

API const char *fmi2GetTypesPlatform(void) { return "default"; }
API const char *fmi2GetVersion(void) { return "2.0"; }
API Status fmi2SetDebugLogging(void *c, int on, size_t n, const char *const categories[]) { return OK; }

API void *fmi2Instantiate(const char *name, int type, const char *guid, const char *location, const Callbacks *callbacks, int visible, int logging) {
    Instance *m = calloc(1, sizeof *m);
    if (!m) return NULL;
    m->name = strdup(name ? name : "");
    if (callbacks) m->callbacks = *callbacks;
    if (!find_python()) {
        say(m, ERROR, "this FMU is written in Python and runs inside a Python process only (fmpy, libcosimpy, ...)");
        free(m->name), free(m);
        return NULL;
    }
    int gil = py.GilEnsure(), good = 0;
    Object space = py.NewDict(), code = py.Compile(OPEN, "fmi2Instantiate", 257 /* a file of statements */);
    if (space && code && !py.SetItem(space, "__builtins__", py.Builtins())) {
        Object nothing = py.Eval(code, space, space);
        if (nothing) {
            py.Drop(nothing);
            m->slave = py.CallFunction(py.GetItem(space, "open_slave"), "ss", location ? location : "", m->name);
            good = m->slave && take_hold(m);
        }
    }
    if (!good) raised(m), let_go(m);
    py.Drop(code), py.Drop(space);
    py.GilRelease(gil);
    if (good) return m;
    free(m->name), free(m);
    return NULL;
}

API void fmi2FreeInstance(void *c) {
    Instance *m = c;
    if (!m) return;
    if (py.IsInitialized()) {
        int gil = py.GilEnsure();
        let_go(m);
        py.GilRelease(gil);
    }
    free(m->name), free(m);
}

static Status plain(Instance *m, const char *method) {
    int gil = py.GilEnsure();
    Status status = done(m, py.CallMethod(m->slave, method, NULL));
    py.GilRelease(gil);
    return status;
}

API Status fmi2SetupExperiment(void *c, int defined, double tolerance, double start, int stops, double stop) { return OK; }
API Status fmi2EnterInitializationMode(void *c) { return plain(c, "enter_initialization_mode"); }

API Status fmi2ExitInitializationMode(void *c) {
    Instance *m = c;
    Status status = plain(m, "exit_initialization_mode");
    if (status == OK) m->stale = 0, m->running = 1;
    return status;
}

API Status fmi2Terminate(void *c) { return plain(c, "terminate"); }

API Status fmi2Reset(void *c) {
    Instance *m = c;
    m->stale = 1, m->running = 0;
    return plain(m, "reset");
}

/* Outputs follow inputs that were set since they were computed. */
static Status settle(Instance *m, const unsigned *references, size_t n) {
    int local = 0;
    for (size_t k = 0; k < n; k++) {
        if (references[k] >= m->count) return refuse(m, "there is no variable with value reference %u", references[k]);
        local |= m->kinds[references[k]] == LOCAL;
    }
    Status status = OK;
    if (m->stale) {
        int gil = py.GilEnsure();
        status = done(m, py.CallFunction(m->settle, NULL));
        py.GilRelease(gil);
        if (status == OK) m->stale = 0;
    }
    return status == OK && local ? plain(m, "reveal") : status;
}

static int may_set(Instance *m, const unsigned *references, size_t n) {
    for (size_t k = 0; k < n; k++) {
        if (references[k] >= m->count) return refuse(m, "there is no variable with value reference %u", references[k]), 0;
        if (m->running && m->kinds[references[k]] == PARAMETER)
            return refuse(m, "value reference %u is a parameter: it can only be set before initialisation", references[k]), 0;
    }
    m->stale = 1;
    return 1;
}

API Status fmi2GetReal(void *c, const unsigned *references, size_t n, double *out) {
    Instance *m = c;
    Status status = settle(m, references, n);
    for (size_t k = 0; k < n && status == OK; k++) out[k] = m->values[references[k]];
    return status;
}

API Status fmi2SetReal(void *c, const unsigned *references, size_t n, const double *in) {
    Instance *m = c;
    if (!may_set(m, references, n)) return ERROR;
    for (size_t k = 0; k < n; k++) m->values[references[k]] = in[k];
    return OK;
}

API Status fmi2GetInteger(void *c, const unsigned *references, size_t n, int *out) {
    Instance *m = c;
    Status status = settle(m, references, n);
    for (size_t k = 0; k < n && status == OK; k++) out[k] = (int)m->values[references[k]];
    return status;
}

API Status fmi2SetInteger(void *c, const unsigned *references, size_t n, const int *in) {
    Instance *m = c;
    if (!may_set(m, references, n)) return ERROR;
    for (size_t k = 0; k < n; k++) m->values[references[k]] = in[k];
    return OK;
}

API Status fmi2GetBoolean(void *c, const unsigned *references, size_t n, int *out) { return fmi2GetInteger(c, references, n, out); }
API Status fmi2SetBoolean(void *c, const unsigned *references, size_t n, const int *in) { return fmi2SetInteger(c, references, n, in); }
API Status fmi2GetString(void *c, const unsigned *references, size_t n, const char **out) { return n ? refuse(c, "there are no texts") : OK; }
API Status fmi2SetString(void *c, const unsigned *references, size_t n, const char *const *in) { return n ? refuse(c, "there are no texts") : OK; }

API Status fmi2DoStep(void *c, double time, double step, int no_state_before) {
    Instance *m = c;
    int gil = py.GilEnsure();
    Status status = done(m, py.CallFunction(m->do_step, "dd", time, step));
    py.GilRelease(gil);
    if (status == OK) m->stale = 0;
    return status;
}

API Status fmi2FreeFMUstate(void *c, Object *state) {
    if (!*state) return OK;
    int gil = py.GilEnsure();
    py.Drop(*state);
    py.GilRelease(gil);
    *state = NULL;
    return OK;
}

API Status fmi2GetFMUstate(void *c, Object *state) {
    Instance *m = c;
    fmi2FreeFMUstate(c, state);
    int gil = py.GilEnsure();
    Object stale = py.FromLong(m->stale);
    *state = py.SetAttr(m->slave, "_stale", stale) ? NULL : py.CallMethod(m->slave, "_get_fmu_state", NULL);
    py.Drop(stale);
    Status status = *state ? OK : raised(m);
    py.GilRelease(gil);
    return status;
}

static int flag(Instance *m, const char *name) {
    Object value = py.GetAttr(m->slave, name);
    int set = value && py.IsTrue(value) > 0;
    py.Drop(value);
    return set;
}

API Status fmi2SetFMUstate(void *c, Object state) {
    Instance *m = c;
    if (!state) return refuse(m, "no state to restore");
    int gil = py.GilEnsure();
    Status status = done(m, py.CallMethod(m->slave, "_set_fmu_state", "O", state));
    m->stale = flag(m, "_stale"), m->running = flag(m, "_running");
    py.GilRelease(gil);
    return status;
}

static Status bytes(Instance *m, Object state, char **data, ssize_t *size) {
    int gil = py.GilEnsure();
    Status status = py.BytesView(state, data, size) ? raised(m) : OK;
    py.GilRelease(gil);
    return status;
}

API Status fmi2SerializedFMUstateSize(void *c, Object state, size_t *size) {
    char *data;
    ssize_t length = 0;
    Status status = bytes(c, state, &data, &length);
    *size = length;
    return status;
}

API Status fmi2SerializeFMUstate(void *c, Object state, char out[], size_t size) {
    char *data;
    ssize_t length;
    Status status = bytes(c, state, &data, &length);
    if (status != OK) return status;
    if ((size_t)length > size) return refuse(c, "the state has %zu bytes, the buffer %zu", (size_t)length, size);
    memcpy(out, data, length);
    return OK;
}

API Status fmi2DeSerializeFMUstate(void *c, const char in[], size_t size, Object *state) {
    fmi2FreeFMUstate(c, state);
    int gil = py.GilEnsure();
    *state = py.BytesFrom(in, size);
    Status status = *state ? OK : raised(c);
    py.GilRelease(gil);
    return status;
}

API Status fmi2GetDirectionalDerivative(void *c, const unsigned *u, size_t nu, const unsigned *k, size_t nk, const double *dk, double *du) {
    return refuse(c, "directional derivatives are not provided");
}
API Status fmi2SetRealInputDerivatives(void *c, const unsigned *r, size_t n, const int *order, const double *in) {
    return refuse(c, "inputs are held over a step: their derivatives cannot be set");
}
API Status fmi2GetRealOutputDerivatives(void *c, const unsigned *r, size_t n, const int *order, double *out) {
    return refuse(c, "derivatives of outputs are not provided");
}
API Status fmi2CancelStep(void *c) { return refuse(c, "steps are synchronous"); }
API Status fmi2GetStatus(void *c, int kind, Status *out) { return DISCARD; }
API Status fmi2GetRealStatus(void *c, int kind, double *out) { return DISCARD; }
API Status fmi2GetIntegerStatus(void *c, int kind, int *out) { return DISCARD; }
API Status fmi2GetBooleanStatus(void *c, int kind, int *out) { return DISCARD; }
API Status fmi2GetStringStatus(void *c, int kind, const char **out) { return DISCARD; }
