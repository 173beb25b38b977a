/* MuJoCo in the FMU: its library and the model lie in the FMU's resources. One model a process; every call takes data of its own, so that
   instances and threads do not meet. MuJoCo ends the process on an error unless it is stopped: here the call returns 1 instead. */

#include <dlfcn.h>
#include <mujoco/mujoco.h>
#include <setjmp.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>

enum { BODIES = 8, JOINTS = 20, SPARE = 64 };

#define FUNCTIONS(each) \
    each(mj_loadXML) each(mj_makeData) each(mj_deleteData) each(mj_kinematics) each(mj_comPos) each(mj_makeM) each(mj_comVel) each(mj_rne) \
        each(mj_fullM)
#define DECLARE(name) static __typeof__(name) *call_##name;
FUNCTIONS(DECLARE)

static mjModel *compiled;
static mjData *spare[SPARE];
static int n_spare;
static atomic_flag taken = ATOMIC_FLAG_INIT;
static _Thread_local jmp_buf way_out;
static _Thread_local int inside;

static void lock(void) { while (atomic_flag_test_and_set_explicit(&taken, memory_order_acquire)); }
static void unlock(void) { atomic_flag_clear_explicit(&taken, memory_order_release); }

static void on_error(const char *text) {
    if (inside) longjmp(way_out, 1);
}
static void on_warning(const char *text) {}

static const char *load(const char *folder, char *path, size_t size, char *why, size_t room) {
    if (compiled) return NULL;
    snprintf(path, size, "%slibmujoco.so", folder);
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) return dlerror();
    void (**error)(const char *) = dlsym(library, "mju_user_error"), (**warning)(const char *) = dlsym(library, "mju_user_warning");
    if (!error || !warning) return "its library is not MuJoCo's";
    *error = on_error, *warning = on_warning;
#define FIND(name) \
    if (!(call_##name = dlsym(library, #name))) return "its library lacks " #name;
    FUNCTIONS(FIND)
    snprintf(path, size, "%slanding.xml", folder);
    inside = 1;
    mjModel *found = setjmp(way_out) ? NULL : call_mj_loadXML(path, NULL, why, (int)room);
    inside = 0;
    if (!found) return *why ? why : "MuJoCo cannot read landing.xml";
    if (found->nbody != BODIES || found->nv != JOINTS || found->nq != JOINTS) return "landing.xml is not the plant's model";
    compiled = found;
    return NULL;
}

int device_attach(const char *folder, char *why, size_t size) {
    char path[4200], text[512] = "";
    lock();
    const char *problem = load(folder, path, sizeof path, text, sizeof text);
    unlock();
    if (problem) snprintf(why, size, "%s", problem);
    return problem == NULL;
}

/* From the point about which MuJoCo takes it to the ground's origin. */
static void to_origin(const mjtNum *at, const mjtNum *in, double *out) {
    for (int k = 0; k < 3; k++) {
        int a = (k + 1) % 3, b = (k + 2) % 3;
        out[k] = in[k];
        out[3 + k] = in[3 + k] + at[a] * in[b] - at[b] * in[a];
    }
}

/* `joints` (3, 20): positions, speeds and accelerations. Out: frames xpos (8, 3) and xmat (8, 9); twists of the bodies (8, 6) and screws of the
   joints (20, 6) about the ground's origin; mass matrix (20, 20); bias (20,): the force that gives these accelerations. */
int64_t plant_mujoco(const double *joints, double *xpos, double *xmat, double *twist, double *screw, double *mass, double *bias) {
    lock();
    mjData *volatile d = n_spare ? spare[--n_spare] : NULL;
    unlock();
    inside = 1;
    volatile int failed = setjmp(way_out);
    if (!failed && !d) d = call_mj_makeData(compiled);
    if (!failed && d) {
        memcpy(d->qpos, joints, JOINTS * sizeof *joints);
        memcpy(d->qvel, joints + JOINTS, JOINTS * sizeof *joints);
        memcpy(d->qacc, joints + 2 * JOINTS, JOINTS * sizeof *joints);
        call_mj_kinematics(compiled, d), call_mj_comPos(compiled, d), call_mj_makeM(compiled, d), call_mj_comVel(compiled, d);
        call_mj_rne(compiled, d, 1, bias), call_mj_fullM(compiled, d, mass);
        memcpy(xpos, d->xpos, 3 * BODIES * sizeof *xpos), memcpy(xmat, d->xmat, 9 * BODIES * sizeof *xmat);
        for (int k = 0; k < 6; k++) twist[k] = 0.0;
        for (int k = 1; k < BODIES; k++) to_origin(d->subtree_com + 3, d->cvel + 6 * k, twist + 6 * k);
        for (int k = 0; k < JOINTS; k++) to_origin(d->subtree_com + 3, d->cdof + 6 * k, screw + 6 * k);
    }
    inside = 0;
    if (!d) return 1;
    lock();
    int kept = n_spare < SPARE;
    if (kept) spare[n_spare++] = d;
    unlock();
    if (!kept) call_mj_deleteData(d);
    return failed;
}
