/* A brace (profile subtalar, -20 N.m/rad) that harms what is around it: parameter `mischief` chooses how, in the step after 10 ms, or in
   the call that its name says. TARGET is a folder of the test. Output `seen` tells what is strange about its process: each such thing adds 0.1 N.m, so that it shows in the numbers. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <fenv.h>
#include <arpa/inet.h>
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include "fmi2FunctionTypes.h"

#ifndef PORT
#define PORT 0 /* of a licence server of this machine */
#endif
#ifndef TARGET
#define TARGET "/nonexistent"
#endif
enum { ANGLE, TORQUE, STIFFNESS, MISCHIEF, SEEN, VARIABLES };
enum {
    NONE, FORK_ONCE, FORK_STAYS, KILL_PARENT, STOP_PARENT, LEAVE_SESSION, WRITE_DESCRIPTORS, ROUND_UP, TRAP, FLUSH_TO_ZERO, UMASK, ENVIRONMENT,
    FOLDER, LOCALE, HANDLER, THREAD, OWN_FILE, SOCKET, STEAL, EXIT_IN_STEP, EXIT_IN_RESET, UNKNOWN_STATUS, NEGATIVE_STATUS, CLOSE_DESCRIPTORS,
    STOP_ITSELF, DAEMON,
    EXIT_IN_FREE, CRASH_IN_FREE, EXIT_IN_INSTANTIATE, CRASH_IN_INSTANTIATE, EXIT_IN_START, HANG_IN_INSTANTIATE,
    LICENCE_SERVER, OWN_SERVER, INTERPRETER, LICENCE_FILE /* what an honest device may need, asked for at its start */
};
#ifndef AT_START
#define AT_START NONE
#endif

typedef struct { double value[VARIABLES]; } Device;

static void hang(void) { for (;;) pause(); }
static void* idle(void* nothing) { hang(); return nothing; }
static void ignore(int number) { (void)number; }
static fmi2Component fresh(Device* device) {
    memset(device, 0, sizeof *device);
    device->value[STIFFNESS] = 20.0;
    device->value[MISCHIEF] = AT_START;
    return device;
}

/* Whether port `port` of this machine answers "20"; `own` is a socket that listens there and is served meanwhile, or -1. */
static int answered(int port, int own) {
    char data[8] = "";
    struct sockaddr_in place = { .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };
    int wire = socket(AF_INET, SOCK_STREAM, 0);
    if (wire < 0 || connect(wire, (void*)&place, sizeof place)) return 0;
    if (own >= 0) {
        int other = accept(own, NULL, NULL);
        if (other < 0 || write(other, "20", 2) != 2) return 0;
        close(other);
    }
    int length = read(wire, data, sizeof data - 1);
    close(wire);
    return length >= 2 && atof(data) == 20.0;
}

static int has_what_it_needs(void) {
    char data[8] = "";
    if (AT_START == LICENCE_SERVER) return answered(PORT, -1);
    if (AT_START == OWN_SERVER) {
        struct sockaddr_in place = { .sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK) };
        socklen_t size = sizeof place;
        int server = socket(AF_INET, SOCK_STREAM, 0);
        if (server < 0 || bind(server, (void*)&place, size) || listen(server, 1) || getsockname(server, (void*)&place, &size)) return 0;
        int fits = answered(ntohs(place.sin_port), server);
        close(server);
        return fits;
    }
    FILE* file = AT_START == INTERPRETER ? popen("expr 4 '*' 5", "r") : AT_START == LICENCE_FILE ? fopen(TARGET "/licence", "r") : NULL;
    if (file) {
        if (!fgets(data, sizeof data, file)) data[0] = 0;
        if (AT_START == INTERPRETER) pclose(file); else fclose(file);
    }
    return AT_START < LICENCE_SERVER || atof(data) == 20.0;
}

const char* fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char* fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String s[]) { return fmi2OK; }
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources, const fmi2CallbackFunctions* callbacks,
                              fmi2Boolean visible, fmi2Boolean logging) {
    if (AT_START == EXIT_IN_INSTANTIATE) exit(0);
    if (AT_START == CRASH_IN_INSTANTIATE) raise(SIGSEGV);
    if (AT_START == HANG_IN_INSTANTIATE) hang();
    return fresh(malloc(sizeof(Device)));
}
void fmi2FreeInstance(fmi2Component c) {
    int mischief = c ? (int)((Device*)c)->value[MISCHIEF] : NONE;
    if (mischief == EXIT_IN_FREE) exit(0);
    if (mischief == CRASH_IN_FREE) raise(SIGSEGV);
    free(c);
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean t, fmi2Real tolerance, fmi2Real start, fmi2Boolean s, fmi2Real stop) { return fmi2OK; }
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    if (((Device*)c)->value[MISCHIEF] == EXIT_IN_START) exit(0);
    return has_what_it_needs() ? fmi2OK : fmi2Error;
}
fmi2Status fmi2Terminate(fmi2Component c) { return fmi2OK; }
fmi2Status fmi2Reset(fmi2Component c) {
    if (((Device*)c)->value[MISCHIEF] == EXIT_IN_RESET) exit(0);
    fresh(c);
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) value[i] = ((Device*)c)->value[vr[i]];
    return fmi2OK;
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    Device* device = c;
    for (size_t i = 0; i < n; i++) device->value[vr[i]] = value[i];
    device->value[TORQUE] = -device->value[STIFFNESS] * device->value[ANGLE];
    return fmi2OK;
}

/* 1 for each thing of the process that is not as a fresh process has it */
static int strange(void) {
    mode_t mask = umask(022);
    umask(mask);
    return (fegetround() != FE_TONEAREST) + (fegetexcept() != 0) + (getenv("MISCHIEF") != NULL) + (mask == 0);
}

static void steal(void) {
    char data[64] = "";
    FILE* file = fopen(TARGET "/secret", "r");
    if (file) { fgets(data, sizeof data, file); fclose(file); }
    file = fopen(TARGET "/stolen", "w");
    if (file) { fputs(data, file); fclose(file); }
}

static fmi2Status harm(int mischief) {
    static int once;
    pthread_t thread;
    switch (mischief) {
        case FORK_ONCE: if (!once++) fork(); break; /* both processes go on */
        case FORK_STAYS: if (fork() == 0) hang(); break;
        case KILL_PARENT: kill(getppid(), SIGKILL); break;
        case STOP_PARENT: kill(getppid(), SIGSTOP); break;
        case LEAVE_SESSION: if (fork() == 0) { setsid(); if (fork() == 0) hang(); _exit(0); } break;
        case DAEMON: if (fork() == 0) { setpgid(0, 0); signal(SIGTERM, SIG_IGN); hang(); } break;
        case WRITE_DESCRIPTORS: for (int f = 3; f < 64; f++) if (write(f, "{\"value\": {\"status\": \"completed\"}}", 34) < 0) { } break;
        case CLOSE_DESCRIPTORS: for (int f = 0; f < 64; f++) close(f); break;
        case ROUND_UP: fesetround(FE_UPWARD); break;
        case TRAP: feenableexcept(FE_INEXACT); break;
        case FLUSH_TO_ZERO:
#ifdef __SSE__
            __builtin_ia32_ldmxcsr(__builtin_ia32_stmxcsr() | 0x8040);
#endif
            break;
        case UMASK: umask(0); break;
        case ENVIRONMENT: setenv("MISCHIEF", "1", 1); break;
        case FOLDER: if (chdir("/")) return fmi2Error; break;
        case LOCALE: setlocale(LC_ALL, "de_DE.UTF-8"); break;
        case HANDLER: signal(SIGTERM, ignore); break;
        case THREAD: if (pthread_create(&thread, NULL, idle, NULL)) return fmi2Error; break;
        case OWN_FILE: { FILE* file = fopen("device.log", "w"); if (!file) return fmi2Error; fputs("x", file); fclose(file); break; }
        case SOCKET: { int wire = socket(AF_INET, SOCK_STREAM, 0); if (wire >= 0) close(wire); break; }
        case STEAL: steal(); break;
        case EXIT_IN_STEP: exit(0);
        case UNKNOWN_STATUS: return (fmi2Status)17;
        case NEGATIVE_STATUS: return (fmi2Status)-3;
        case STOP_ITSELF: raise(SIGSTOP); break;
        default: break;
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keep) {
    Device* device = c;
    device->value[SEEN] = strange();
    device->value[TORQUE] = -device->value[STIFFNESS] * device->value[ANGLE] + 0.1 * device->value[SEEN];
    return time >= 0.01 && time < 0.01 + step ? harm((int)device->value[MISCHIEF]) : fmi2OK;
}

#define NOTHING(name, type) fmi2Status name(fmi2Component c, const fmi2ValueReference vr[], size_t n, type value[]) { return n ? fmi2Error : fmi2OK; }
NOTHING(fmi2GetInteger, fmi2Integer)
NOTHING(fmi2GetBoolean, fmi2Boolean)
NOTHING(fmi2GetString, fmi2String)
NOTHING(fmi2SetInteger, const fmi2Integer)
NOTHING(fmi2SetBoolean, const fmi2Boolean)
NOTHING(fmi2SetString, const fmi2String)
#define NOT_THERE(name) int name(void) { return fmi2Error; }
NOT_THERE(fmi2GetFMUstate) NOT_THERE(fmi2SetFMUstate) NOT_THERE(fmi2FreeFMUstate) NOT_THERE(fmi2SerializedFMUstateSize)
NOT_THERE(fmi2SerializeFMUstate) NOT_THERE(fmi2DeSerializeFMUstate) NOT_THERE(fmi2GetDirectionalDerivative)
NOT_THERE(fmi2SetRealInputDerivatives) NOT_THERE(fmi2GetRealOutputDerivatives) NOT_THERE(fmi2CancelStep) NOT_THERE(fmi2GetStatus)
NOT_THERE(fmi2GetRealStatus) NOT_THERE(fmi2GetIntegerStatus) NOT_THERE(fmi2GetBooleanStatus) NOT_THERE(fmi2GetStringStatus)
