"""System calls that a sandbox refuses, or refuses some uses of, with their numbers. Numbers: the kernel's tables
arch/x86/entry/syscalls/syscall_64.tbl and include/uapi/asm-generic/unistd.h (64-bit ARM and RISC-V)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

NEWEST = 469
"""The newest system call that the table below was made with; the kernel's answer to later ones is that it has none."""

TABLE = """
    accept 43 202 | accept4 288 242 | acct 163 89 | add_key 248 217 | adjtimex 159 171 | bind 49 200 |
    bpf 321 280 | chdir 80 49 | chmod 90 - | chown 92 - | chroot 161 51 | clock_adjtime 305 266 |
    clock_settime 227 112 | clone 56 220 | clone3 435 435 | connect 42 203 | creat 85 - | delete_module 176 106 |
    execve 59 221 | execveat 322 281 | fanotify_init 300 262 | fanotify_mark 301 263 | fchmod 91 52 |
    fchmodat 268 53 | fchmodat2 452 452 | fchown 93 55 | fchownat 260 54 | fcntl 72 25 | file_setattr 469 469 |
    finit_module 313 273 | fork 57 - | fremovexattr 199 16 | fsconfig 431 431 | fsetxattr 190 7 | fsmount 432 432 |
    fsopen 430 430 | fspick 433 433 | futimesat 261 - | init_module 175 105 | inotify_add_watch 254 27 |
    inotify_init 253 - | inotify_init1 294 26 | io_uring_enter 426 426 | io_uring_register 427 427 |
    io_uring_setup 425 425 | ioctl 16 29 | ioperm 173 - | iopl 172 - | ioprio_set 251 30 | kcmp 312 272 |
    kexec_file_load 320 294 | kexec_load 246 104 | keyctl 250 219 | kill 62 129 | lchown 94 - | listen 50 201 |
    lookup_dcookie 212 18 | lremovexattr 198 15 | lsetxattr 189 6 | migrate_pages 256 238 | modify_ldt 154 - |
    mount 165 40 | mount_setattr 442 442 | move_mount 429 429 | move_pages 279 239 | mq_notify 244 184 |
    mq_open 240 180 | mq_timedreceive 243 183 | mq_timedsend 242 182 | mq_unlink 241 181 | msgctl 71 187 |
    msgget 68 186 | msgrcv 70 188 | msgsnd 69 189 | name_to_handle_at 303 264 | nfsservctl 180 42 | open 2 - |
    open_by_handle_at 304 265 | open_tree 428 428 | open_tree_attr 467 467 | openat 257 56 | openat2 437 437 |
    perf_event_open 298 241 | personality 135 92 | pidfd_getfd 438 438 | pidfd_open 434 434 |
    pidfd_send_signal 424 424 | pivot_root 155 41 | prctl 157 167 | prlimit64 302 261 | process_madvise 440 440 |
    process_mrelease 448 448 | process_vm_readv 310 270 | process_vm_writev 311 271 | ptrace 101 117 |
    quotactl 179 60 | quotactl_fd 443 443 | reboot 169 142 | removexattr 197 14 | removexattrat 466 466 |
    request_key 249 218 | rt_sigqueueinfo 129 138 | rt_tgsigqueueinfo 297 240 | sched_setaffinity 203 122 |
    sched_setattr 314 274 | sched_setparam 142 118 | sched_setscheduler 144 119 | seccomp 317 277 | semctl 66 191 |
    semget 64 190 | semop 65 193 | semtimedop 220 192 | sendmmsg 307 269 | sendmsg 46 211 | sendto 44 206 |
    setdomainname 171 162 | setfsgid 123 152 | setfsuid 122 151 | setgid 106 144 | setgroups 116 159 |
    sethostname 170 161 | setns 308 268 | setpgid 109 154 | setpriority 141 140 | setregid 114 143 |
    setresgid 119 149 | setresuid 117 147 | setreuid 113 145 | setsid 112 157 | settimeofday 164 170 |
    setuid 105 146 | setxattr 188 5 | setxattrat 463 463 | shmat 30 196 | shmctl 31 195 | shmget 29 194 |
    socket 41 198 | swapoff 168 225 | swapon 167 224 | syslog 103 116 | tgkill 234 131 | tkill 200 130 |
    truncate 76 45 | umask 95 166 | umount2 166 39 | unshare 272 97 | uselib 134 - | userfaultfd 323 282 |
    utime 132 - | utimensat 280 88 | utimes 235 - | vfork 58 - | vhangup 153 58
"""


def _column(place: int) -> dict[str, int]:
    rows = (row.split() for row in TABLE.replace("|", "\n").splitlines() if row.strip())
    return {row[0]: int(row[place]) for row in rows if row[place] != "-"}


COLUMNS: Mapping[str, Mapping[str, int]] = {
    "x86_64": _column(1),
    "aarch64": _column(2),
    "riscv64": _column(2),
}
ARCHITECTURES = {"x86_64": 0xC000003E, "aarch64": 0xC00000B7, "riscv64": 0xC00000F3}  # AUDIT_ARCH_*
OTHER_INTERFACE = 0x40000000  # numbers from here on are those of x32 on x86_64

EPERM, ENOSYS, EAFNOSUPPORT = 1, 38, 97
OPENING = ("open", "openat", "openat2", "creat")
WATCHED = (*OPENING, "clone", "fork", "vfork", "umask", "chdir", "fchdir", "execve", "connect", "bind", "truncate")
"""Calls that a watched process announces, whether they are refused or not."""


class Condition(NamedTuple):
    """On the low 32 bits of an argument, counted from 0: it is `among` the values, `not among` them, or has `any bit`
    or `no bit` of the values."""

    argument: int
    test: str
    values: tuple[int, ...]

    def holds(self, arguments: tuple[int, ...]) -> bool:
        value = arguments[self.argument] & 0xFFFFFFFF
        if self.test in ("any bit", "no bit"):
            return (value & self.values[0] != 0) == (self.test == "any bit")
        return (value in self.values) == (self.test == "among")


class Refusal(NamedTuple):
    """A call is let through when all conditions hold (none: never); otherwise it fails with `error`. `topic` is what
    the call is about, in the words of a note to the user."""

    topic: str
    conditions: tuple[Condition, ...] = ()
    error: int = EPERM

    def refuses(self, arguments: tuple[int, ...]) -> bool:
        return not self.conditions or not all(condition.holds(arguments) for condition in self.conditions)


ALWAYS = {
    "other processes": "ptrace process_vm_readv process_vm_writev process_madvise process_mrelease kcmp pidfd_open "
    "pidfd_getfd pidfd_send_signal migrate_pages move_pages perf_event_open",
    "process groups": "setsid setpgid",
    "the machine": "mount umount2 pivot_root chroot fsopen fsconfig fsmount fspick move_mount open_tree open_tree_attr "
    "mount_setattr unshare setns bpf kexec_load kexec_file_load init_module finit_module delete_module reboot swapon "
    "swapoff acct quotactl quotactl_fd syslog settimeofday clock_settime clock_adjtime adjtimex sethostname "
    "setdomainname iopl ioperm modify_ldt vhangup uselib lookup_dcookie nfsservctl userfaultfd",
    "keys": "keyctl add_key request_key",
    "users": "setuid setgid setreuid setregid setresuid setresgid setgroups setfsuid setfsgid",
    "files by handle or watch": "name_to_handle_at open_by_handle_at fanotify_init fanotify_mark inotify_init "
    "inotify_init1 inotify_add_watch",
    "owners, rights and dates of files": "chmod fchmod fchmodat fchmodat2 chown lchown fchown fchownat setxattr "
    "lsetxattr fsetxattr removexattr lremovexattr fremovexattr setxattrat removexattrat file_setattr utime utimes "
    "utimensat futimesat",
    "shared memory and queues": "shmget shmat shmctl semget semop semctl semtimedop msgget msgsnd msgrcv msgctl "
    "mq_open mq_unlink mq_timedsend mq_timedreceive mq_notify",
}
NEW_NAMESPACES, OF_THE_PARENT, THREAD, FASTOPEN = 0x7E020080, 0x8000, 0x10000, 0x20000000
SIGNALS = "kill tkill tgkill rt_sigqueueinfo rt_tgsigqueueinfo"
SOCKETS = "socket connect bind listen accept accept4"
FAMILIES = (2, 10)  # IPv4, IPv6
OWNERSHIP = (8, 10, 15, 1024, 1026)  # F_SETOWN, F_SETSIG, F_SETOWN_EX, F_SETLEASE, F_NOTIFY
TERMINAL = (0x5412, 0x540E, 0x5410, 0x541C)  # TIOCSTI, TIOCSCTTY, TIOCSPGRP, TIOCLINUX
FLAGS = (0x8901, 0x8902, 0x40086602, 0x401C5820)  # FIOSETOWN, SIOCSPGRP, FS_IOC_SETFLAGS, FS_IOC_FSSETXATTR
PROCESS_WIDE = (1, 35, 36, 0x59616D61)  # PR_SET_PDEATHSIG, _MM, _CHILD_SUBREAPER, _PTRACER


def refusals(process: int, network: bool = False, execute: bool = False, truncate: bool = False) -> dict[str, Refusal]:
    """{call: refusal} of a sandbox. `process` its own number; `network`: it may use sockets of the Internet families;
    `execute`: it may start processes and programs; `truncate`: Landlock does not govern truncation."""
    own = (0, process)
    found = {name: Refusal(topic) for topic, names in ALWAYS.items() for name in names.split()}
    found |= {name: Refusal("io_uring", error=ENOSYS) for name in ("io_uring_setup", "io_uring_enter")}
    found["io_uring_register"] = Refusal("io_uring", error=ENOSYS)
    found["prlimit64"] = Refusal("other processes", (Condition(0, "among", own),))
    found["setpriority"] = Refusal("other processes", (Condition(0, "among", (0,)), Condition(1, "among", own)))
    found["ioprio_set"] = Refusal("other processes", (Condition(0, "among", (1,)), Condition(1, "among", own)))
    for name in ("sched_setaffinity", "sched_setscheduler", "sched_setparam", "sched_setattr"):
        found[name] = Refusal("other processes", (Condition(0, "among", own),))
    found["fcntl"] = Refusal("signals", (Condition(1, "not among", OWNERSHIP),))
    found["ioctl"] = Refusal("terminals and flags of files", (Condition(1, "not among", TERMINAL + FLAGS),))
    found["prctl"] = Refusal("its end with its parent", (Condition(0, "not among", PROCESS_WIDE),))
    found["personality"] = Refusal("the machine", (Condition(0, "among", (0xFFFFFFFF,)),))
    found["clone3"] = Refusal("processes", error=ENOSYS)  # its flags lie in memory; the C library then takes clone
    if execute:
        found["clone"] = Refusal("namespaces", (Condition(0, "no bit", (NEW_NAMESPACES | OF_THE_PARENT,)),))
    else:
        found["clone"] = Refusal("processes", (Condition(0, "any bit", (THREAD,)),))
        found |= {name: Refusal("processes") for name in ("fork", "vfork")}
        found |= {name: Refusal("programs") for name in ("execve", "execveat")}
        for name in SIGNALS.split():
            found[name] = Refusal("signals", (Condition(0, "among", own if name == "kill" else own[1:]),))
    if network:
        found["socket"] = Refusal("sockets", (Condition(0, "among", FAMILIES),), EAFNOSUPPORT)
    else:
        found |= {name: Refusal("sockets") for name in SOCKETS.split()}
        for name, place in (("sendto", 3), ("sendmsg", 2), ("sendmmsg", 3)):
            found[name] = Refusal("sockets", (Condition(place, "no bit", (FASTOPEN,)),))
    if truncate:
        found["truncate"] = Refusal("truncation")
    return found
