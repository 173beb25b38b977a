/* MuJoCo in the FMU: its library and the model lie in the FMU's resources. The base person's model is one a process, a scaled person's is a copy
   with other constants; every call takes a model and data of its own, so that instances and threads do not meet. MuJoCo ends the process on an
   error unless it is stopped: here the call returns 1 instead. */

#include <dlfcn.h>
#include <mujoco/mujoco.h>
#include <setjmp.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { BODIES = 8, JOINTS = 20, SPARE = 64 };

/* Of a person: masses, mass centres, inertias in the bodies' frames, joint centres in the bodies and in their parents. */
typedef struct {
    double mass[BODIES], com[BODIES][3], inertia[BODIES][9], anchor[BODIES][3], in_parent[BODIES][3];
} Person;

typedef struct {
    int scaled;
    Person person;
    mjModel *model;
    mjData *data;
} Body;

#define FUNCTIONS(each) \
    each(mj_loadXML) each(mj_makeData) each(mj_deleteData) each(mj_kinematics) each(mj_comPos) each(mj_makeM) each(mj_comVel) each(mj_rne) \
        each(mj_fullM) each(mj_copyModel) each(mj_deleteModel) each(mj_setConst) each(mju_eig3)
#define DECLARE(name) static __typeof__(name) *call_##name;
FUNCTIONS(DECLARE)

static mjModel *compiled;
static Body *spare[SPARE];
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

/* Joint centres, masses and inertias of a copy of the model become the person's. */
static void shape(mjModel *m, const Person *who) {
    for (int b = 1; b < BODIES; b++) {
        mjtNum moments[3], axes[9];
        for (int c = 0; c < 3; c++) {
            m->body_pos[3 * b + c] = who->in_parent[b][c] - who->anchor[b][c];
            m->body_ipos[3 * b + c] = who->com[b][c];
            for (int j = 0; j < m->body_jntnum[b]; j++) m->jnt_pos[3 * (m->body_jntadr[b] + j) + c] = who->anchor[b][c];
        }
        call_mju_eig3(moments, axes, m->body_iquat + 4 * b, who->inertia[b]);
        memcpy(m->body_inertia + 3 * b, moments, sizeof moments);
        m->body_mass[b] = who->mass[b];
    }
}

/* A free body of this person, out of the spare ones if there is one; NULL: none, and no memory. */
static Body *take(int scaled, const Person *who) {
    Body *found = NULL;
    lock();
    for (int k = n_spare; k-- > 0 && !found;)
        if (spare[k]->scaled == scaled && (!scaled || !memcmp(&spare[k]->person, who, sizeof *who))) found = spare[k], spare[k] = spare[--n_spare];
    if (!found && n_spare == SPARE) found = spare[0], spare[0] = spare[--n_spare], found->scaled = -1;
    unlock();
    return found ? found : calloc(1, sizeof *found);
}

static void give_back(Body *body) {
    lock();
    int kept = n_spare < SPARE;
    if (kept) spare[n_spare++] = body;
    unlock();
    if (kept) return;
    if (body->data) call_mj_deleteData(body->data);
    if (body->model && body->model != compiled) call_mj_deleteModel(body->model);
    free(body);
}

/* A body that was of nobody, or of another person, becomes one of this person. */
static void become(Body *body, int scaled, const Person *who) {
    body->scaled = -1;
    if (!scaled) {
        if (body->model && body->model != compiled) call_mj_deleteModel(body->model);
        body->model = compiled;
    } else if (body->model == compiled || !body->model) body->model = call_mj_copyModel(NULL, compiled);
    if (!body->data) body->data = call_mj_makeData(body->model);
    if (scaled) shape(body->model, who), call_mj_setConst(body->model, body->data);
    body->scaled = scaled, body->person = *who;
}

/* `joints` (3, 20): positions, speeds and accelerations; `scaled`: the person is not the base person, and then of the bodies (8): masses, mass
   centres (3), inertias (3, 3), joint centres in the body and in its parent (3). Out: frames xpos (8, 3) and xmat (8, 9); twists of the bodies
   (8, 6) and screws of the joints (20, 6) about the ground's origin; mass matrix (20, 20); bias (20,): the force that gives these accelerations. */
int64_t plant_mujoco(const double *joints, int64_t scaled, const double *body_mass, const double *com, const double *inertia, const double *anchor,
                     const double *in_parent, double *xpos, double *xmat, double *twist, double *screw, double *mass, double *bias) {
    Person who;
    memcpy(who.mass, body_mass, sizeof who.mass), memcpy(who.com, com, sizeof who.com), memcpy(who.inertia, inertia, sizeof who.inertia);
    memcpy(who.anchor, anchor, sizeof who.anchor), memcpy(who.in_parent, in_parent, sizeof who.in_parent);
    Body *volatile body = take(scaled != 0, &who);
    if (!body) return 1;
    inside = 1;
    volatile int failed = setjmp(way_out);
    if (!failed && (!body->data || body->scaled != (scaled != 0))) become(body, scaled != 0, &who);
    if (!failed) {
        const mjModel *m = body->model;
        mjData *d = body->data;
        memcpy(d->qpos, joints, JOINTS * sizeof *joints);
        memcpy(d->qvel, joints + JOINTS, JOINTS * sizeof *joints);
        memcpy(d->qacc, joints + 2 * JOINTS, JOINTS * sizeof *joints);
        call_mj_kinematics(m, d), call_mj_comPos(m, d), call_mj_makeM(m, d), call_mj_comVel(m, d);
        call_mj_rne(m, d, 1, bias), call_mj_fullM(m, d, mass);
        memcpy(xpos, d->xpos, 3 * BODIES * sizeof *xpos), memcpy(xmat, d->xmat, 9 * BODIES * sizeof *xmat);
        for (int k = 0; k < 6; k++) twist[k] = 0.0;
        for (int k = 1; k < BODIES; k++) to_origin(d->subtree_com + 3, d->cvel + 6 * k, twist + 6 * k);
        for (int k = 0; k < JOINTS; k++) to_origin(d->subtree_com + 3, d->cdof + 6 * k, screw + 6 * k);
    }
    inside = 0;
    give_back(body);
    return failed;
}
