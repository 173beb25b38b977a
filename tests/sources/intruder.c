/* A brace (profile subtalar, -20 N.m/rad) that tries to reach what is not its own. Each attempt returns 1 when it succeeded.
   TARGET is a folder of the test with `secret` and `victim` in it, PORT a port on 127.0.0.1 where the test listens.
   Loaded as a plain library: `attempts()`, `attempt_name(k)`, `attempt(k)`. As an FMI 2.0 FMU: parameter `attempt` is k + 1, output `succeeded`;
   parameter `mischief` chooses one of the deeds at the end, done in the step after 10 ms. */
#define _GNU_SOURCE
#include <arpa/inet.h>
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <fenv.h>
#include <linux/bpf.h>
#include <linux/perf_event.h>
#include <math.h>
#include <netinet/in.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/inotify.h>
#include <sys/ioctl.h>
#include <sys/ipc.h>
#include <sys/mman.h>
#include <sys/mount.h>
#include <sys/personality.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/shm.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <utime.h>

#ifndef TARGET
#define TARGET "/nonexistent"
#endif
#ifndef PORT
#define PORT 9
#endif
#define SECRET TARGET "/secret"
#define VICTIM TARGET "/victim"

static int reads(const char* path) {
    char data[8];
    int file = open(path, O_RDONLY);
    if (file < 0) return 0;
    int found = read(file, data, sizeof data) > 0;
    close(file);
    return found;
}
static int writes(const char* path, int flags) {
    int file = open(path, O_WRONLY | flags, 0600);
    if (file < 0) return 0;
    int done = write(file, "x", 1) == 1;
    close(file);
    return done;
}
static const char* of_parent(const char* what) {
    static char path[64];
    snprintf(path, sizeof path, "/proc/%d/%s", (int)getppid(), what);
    return path;
}
static int reap(pid_t child) { /* in the parent; the child of a fork ends at once */
    if (child == 0) _exit(0);
    return child > 0 && waitpid(child, NULL, 0) == child;
}
static int ran(int status) { return WIFEXITED(status) && WEXITSTATUS(status) == 0; }
static int reaches(int family, int type) {
    struct sockaddr_in there = {.sin_family = AF_INET, .sin_port = htons(PORT), .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int wire = socket(family, type, 0);
    int done = wire >= 0 && connect(wire, (struct sockaddr*)&there, sizeof there) == 0;
    if (wire >= 0) close(wire);
    return done;
}

static int secret_read(void) { return reads(SECRET); }
static int shadow_read(void) { return reads("/etc/shadow") || reads("/etc/passwd"); }
static int folder_listed(void) { DIR* d = opendir(TARGET); if (d) closedir(d); return d != NULL; }
static int home_listed(void) { const char* home = getenv("HOME"); DIR* d = opendir(home ? home : "/root"); if (d) closedir(d); return d != NULL; }
static int parent_environment(void) { return reads(of_parent("environ")); }
static int parent_memory(void) { int f = open(of_parent("mem"), O_RDWR); if (f >= 0) close(f); return f >= 0; }
static int parent_files(void) { DIR* d = opendir(of_parent("fd")); if (d) closedir(d); return d != NULL; }
static int link_read(void) { char p[] = "/tmp/XXXXXX"; symlink(SECRET, "shortcut"); return reads("shortcut"); }
static int hard_link_read(void) { return link(SECRET, "twin") == 0 && reads("twin"); }
static int dot_dot_read(void) { return reads("../../../../../../../../../../../.." SECRET); }
static int openat2_read(void) {
    struct { unsigned long long flags, mode, resolve; } how = {O_RDONLY, 0, 0};
    int f = syscall(SYS_openat2, AT_FDCWD, SECRET, &how, sizeof how);
    if (f >= 0) close(f);
    return f >= 0;
}
static int mapped_read(void) { int f = open(SECRET, O_RDONLY); void* p = f < 0 ? MAP_FAILED : mmap(NULL, 1, PROT_READ, MAP_PRIVATE, f, 0); return p != MAP_FAILED; }
static int file_created(void) { return writes(TARGET "/new", O_CREAT); }
static int temporary_created(void) { char p[] = "/tmp/intruder-XXXXXX"; int f = mkstemp(p); if (f >= 0) { close(f); unlink(p); } return f >= 0; }
static int shared_memory_file(void) { int f = open("/dev/shm/intruder", O_RDWR | O_CREAT, 0600); if (f >= 0) { close(f); unlink("/dev/shm/intruder"); } return f >= 0; }
static int victim_appended(void) { return writes(VICTIM, O_APPEND); }
static int victim_emptied(void) { return truncate(VICTIM, 0) == 0; }
static int victim_replaced(void) { return writes("fresh", O_CREAT) && rename("fresh", VICTIM) == 0; }
static int victim_moved(void) { return rename(VICTIM, TARGET "/moved") == 0 && rename(TARGET "/moved", VICTIM) == 0; }
static int victim_removed(void) { return unlink(VICTIM) == 0 && writes(VICTIM, O_CREAT); }
static int folder_made(void) { return mkdir(TARGET "/folder", 0700) == 0 && rmdir(TARGET "/folder") == 0; }
static int symbolic_link_made(void) { return symlink("/etc", TARGET "/etc") == 0 && unlink(TARGET "/etc") == 0; }
static int pipe_made(void) { return mkfifo(TARGET "/pipe", 0600) == 0 && unlink(TARGET "/pipe") == 0; }
static int rights_changed(void) { return chmod(VICTIM, 0777) == 0; }
static int owner_changed(void) { return chown(VICTIM, getuid(), getgid()) == 0; }
static int dates_changed(void) { return utimes(VICTIM, NULL) == 0; }
static int own_library_changed(void) { Dl_info me; return dladdr((void*)own_library_changed, &me) && access(me.dli_fname, W_OK) == 0 && writes(me.dli_fname, O_APPEND); }
static int device_opened(void) { int f = open("/dev/kmsg", O_RDWR); if (f < 0) f = open("/dev/tty", O_RDWR); if (f >= 0) close(f); return f >= 0; }
static int changes_watched(void) { int f = inotify_init(); return f >= 0 && inotify_add_watch(f, TARGET, IN_ALL_EVENTS) >= 0; }
static int tcp(void) { return reaches(AF_INET, SOCK_STREAM); }
static int udp(void) { return reaches(AF_INET, SOCK_DGRAM); }
static int listening(void) {
    struct sockaddr_in here = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_LOOPBACK)};
    int wire = socket(AF_INET, SOCK_STREAM, 0);
    int done = wire >= 0 && bind(wire, (struct sockaddr*)&here, sizeof here) == 0 && listen(wire, 1) == 0;
    if (wire >= 0) close(wire);
    return done;
}
static int unix_socket(void) { int s = socket(AF_UNIX, SOCK_STREAM, 0); if (s >= 0) close(s); return s >= 0; }
static int netlink(void) { int s = socket(AF_NETLINK, SOCK_RAW, 0); if (s >= 0) close(s); return s >= 0; }
static int forked(void) { return reap(fork()); }
static int vforked(void) { pid_t c = vfork(); if (c == 0) _exit(0); return c > 0 && waitpid(c, NULL, 0) == c; }
static int raw_clone(void) { pid_t c = syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0); return reap(c); }
static int clone3_called(void) { struct { unsigned long long a[8]; } how = {{0, 0, 0, 0, SIGCHLD}}; return reap(syscall(SYS_clone3, &how, 64)); }
static int shell(void) { int status = system("true"); return status != -1 && ran(status); }
static int spawned(void) { pid_t c; char* words[] = {"/bin/true", NULL}; int s; return posix_spawn(&c, words[0], NULL, NULL, words, NULL) == 0 && waitpid(c, &s, 0) == c && ran(s); }
static int executed_from_memory(void) { /* with arguments that fail after the check of rights, so that this process goes on if it was not refused */
    errno = 0;
    int f = memfd_create("x", 0);
    char* words[] = {NULL};
    syscall(SYS_execveat, f, "", words, words, AT_EMPTY_PATH);
    return errno == ENOEXEC || errno == EACCES;
}
static int signal_to_parent(void) { return kill(getppid(), SIGCONT) == 0; }
static int signal_to_all(void) { return kill(1, 0) == 0; }
static int signal_by_thread(void) { return syscall(SYS_tgkill, getppid(), getppid(), SIGCONT) == 0; }
static int signal_by_tkill(void) { return syscall(SYS_tkill, getppid(), SIGCONT) == 0; }
static int signal_queued(void) { union sigval v = {0}; return sigqueue(getppid(), SIGCONT, v) == 0; }
static int signal_by_descriptor(void) { int p = syscall(SYS_pidfd_open, getppid(), 0); return p >= 0 && syscall(SYS_pidfd_send_signal, p, SIGCONT, NULL, 0) == 0; }
static int signal_by_file(void) { int p[2]; return pipe(p) == 0 && fcntl(p[0], F_SETOWN, getppid()) == 0; }
static int traced(void) { int done = ptrace(PTRACE_SEIZE, getppid(), 0, 0) == 0; if (done) ptrace(PTRACE_DETACH, getppid(), 0, 0); return done; }
static int memory_of_parent(void) { /* an address that is not mapped: EFAULT says that the rights were there */
    char data[1];
    struct iovec here = {data, 1}, there = {(void*)4096, 1};
    return process_vm_readv(getppid(), &here, 1, &there, 1, 0) == 1 || errno == EFAULT;
}
static int limits_of_parent(void) { struct rlimit l; return prlimit(getppid(), RLIMIT_CORE, NULL, &l) == 0; }
static int priority_of_parent(void) { return setpriority(PRIO_PROCESS, getppid(), 0) == 0; }
static int cores_of_parent(void) { cpu_set_t set; return sched_getaffinity(getppid(), sizeof set, &set) == 0 && sched_setaffinity(getppid(), sizeof set, &set) == 0; }
static int session_left(void) { return setsid() >= 0; }
static int group_left(void) { return setpgid(0, getppid()) == 0 || setpgid(0, getpgid(getppid())) == 0 || (errno != EPERM && setpgid(0, 0) == 0); }
static int outlives_parent(void) { return prctl(PR_SET_PDEATHSIG, 0) == 0; }
static int namespaces(void) { return unshare(CLONE_FS) == 0; }
static int mounted(void) { return mount("none", TARGET, "tmpfs", 0, NULL) == 0 && umount(TARGET) == 0; }
static int rooted(void) { return chroot("/") == 0; }
static int key_added(void) { return syscall(SYS_add_key, "user", "intruder", "x", 1, -2) >= 0; }
static int kernel_program(void) { union bpf_attr a; memset(&a, 0, sizeof a); a.map_type = BPF_MAP_TYPE_ARRAY; a.key_size = a.value_size = 4; a.max_entries = 1; return syscall(SYS_bpf, BPF_MAP_CREATE, &a, sizeof a) >= 0; }
static int events_of_kernel(void) { struct perf_event_attr a; memset(&a, 0, sizeof a); a.size = sizeof a; a.type = PERF_TYPE_SOFTWARE; return syscall(SYS_perf_event_open, &a, 0, -1, -1, 0) >= 0; }
static int rings(void) { char parameters[120]; memset(parameters, 0, sizeof parameters); return syscall(SYS_io_uring_setup, 1, parameters) >= 0; }
static int faults_handled(void) { return syscall(SYS_userfaultfd, 0) >= 0; }
static int shared_segment(void) { int s = shmget(IPC_PRIVATE, 1, IPC_CREAT | 0600); if (s >= 0) shmctl(s, IPC_RMID, NULL); return s >= 0; }
static int clock_set(void) { struct timespec now; clock_gettime(CLOCK_REALTIME, &now); return clock_settime(CLOCK_REALTIME, &now) == 0; }
static int user_changed(void) { return setuid(getuid()) == 0; }
static int character(void) { return personality(personality(0xffffffff)) != -1; }
static int by_handle(void) { struct { struct file_handle h; char room[128]; } f = {{128}}; int m; return name_to_handle_at(AT_FDCWD, SECRET, &f.h, &m, 0) == 0; }
static int kernel_log(void) { return syscall(SYS_syslog, 10, NULL, 0) >= 0; }

typedef struct { const char* name; int (*call)(void); } Attempt;
#define TRY(f) {#f, f}
static const Attempt table[] = {
    TRY(secret_read), TRY(shadow_read), TRY(folder_listed), TRY(home_listed), TRY(parent_environment), TRY(parent_memory), TRY(parent_files),
    TRY(link_read), TRY(hard_link_read), TRY(dot_dot_read), TRY(openat2_read), TRY(mapped_read), TRY(file_created), TRY(temporary_created),
    TRY(shared_memory_file), TRY(victim_appended), TRY(victim_emptied), TRY(victim_replaced), TRY(victim_moved), TRY(victim_removed),
    TRY(folder_made), TRY(symbolic_link_made), TRY(pipe_made), TRY(rights_changed), TRY(owner_changed), TRY(dates_changed),
    TRY(own_library_changed), TRY(device_opened), TRY(changes_watched), TRY(tcp), TRY(udp), TRY(listening), TRY(unix_socket), TRY(netlink),
    TRY(forked), TRY(vforked), TRY(raw_clone), TRY(clone3_called), TRY(shell), TRY(spawned), TRY(executed_from_memory),
    TRY(signal_to_parent), TRY(signal_to_all), TRY(signal_by_thread), TRY(signal_by_tkill), TRY(signal_queued), TRY(signal_by_descriptor),
    TRY(signal_by_file), TRY(traced), TRY(memory_of_parent), TRY(limits_of_parent), TRY(priority_of_parent), TRY(cores_of_parent),
    TRY(outlives_parent), TRY(namespaces), TRY(mounted), TRY(rooted), TRY(key_added), TRY(kernel_program), TRY(events_of_kernel), TRY(rings),
    TRY(faults_handled), TRY(shared_segment), TRY(clock_set), TRY(user_changed), TRY(character), TRY(by_handle), TRY(kernel_log),
    TRY(group_left), TRY(session_left),
};
int attempts(void) { return sizeof table / sizeof *table; }
const char* attempt_name(int k) { return table[k].name; }
int attempt(int k) { return table[k].call(); }
