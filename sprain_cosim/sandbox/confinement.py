"""The sandbox itself: what a process keeps once it has entered.

Files: it reads what it is given, system libraries, this Python with its packages; it writes to its scratch folder.
Nothing else is opened, changed, moved or removed. No socket, no other process, no program started, no signal to others,
no process group left, no debugging, mounting, key or kernel interface (see `syscalls`). Threads, memory, its own files
and clocks remain. What is granted comes on top."""

from __future__ import annotations

import contextlib
import ctypes
import os
import socket
import struct
import sys
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from ..errors import EnvironmentProblem
from . import landlock, seccomp
from .allowed import NOTHING, Allowed
from .kernel import SIGNAL_ABI, TRUNCATE_ABI, Offer, checked, libc, offered, prctl
from .syscalls import WATCHED, Refusal, refusals

LIBRARIES = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/libexec", "/usr/local/lib", "/usr/local/lib64")
LINKER = "/etc/ld.so.conf.d"
STORES = ("/nix/store", "/gnu/store")  # where distributions without /usr/lib keep theirs
SYSTEM = (
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/usr/share/zoneinfo",
    "/usr/share/locale",
    "/proc/self",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/stat",
    "/proc/sys/vm",
    "/sys/devices/system/cpu",
    "/sys/devices/system/node",
    "/sys/fs/cgroup",
    "/dev/zero",
    "/dev/random",
    "/dev/urandom",
)
PROGRAMS = ("/usr", "/bin", "/sbin", "/etc/alternatives", "/etc/ld.so.preload", "/proc")
NAMES = ("/etc/resolv.conf", "/etc/hosts", "/etc/nsswitch.conf", "/etc/host.conf", "/etc/gai.conf", "/etc/services")
CERTIFICATES = ("/etc/ssl", "/etc/pki", "/etc/ca-certificates", "/usr/share/ca-certificates", "/run/systemd/resolve")

NO_NEW_PRIVILEGES, GET_DEATH_SIGNAL, DROP_CAPABILITY, AMBIENT, CLEAR_ALL = 38, 2, 24, 47, 4
CAPABILITIES, READ_ANY_FILE, MANAGE_MACHINE = 64, 2, 21  # CAP_DAC_READ_SEARCH, CAP_SYS_ADMIN
NEW_USER, NEW_NETWORK = 0x10000000, 0x40000000
GET_INTERFACE_FLAGS, SET_INTERFACE_FLAGS, UP = 0x8913, 0x8914, 1


@dataclass(frozen=True)
class Confinement:
    """`readable` files and folders of its own; `scratch` the folder that it may write to; `allowed` what is granted
    besides; `largest` [B] file that it may write; `descriptors` and `processes` (where it may start any) that it may
    have."""

    readable: tuple[str, ...]
    scratch: str
    allowed: Allowed = NOTHING
    largest: int = 1 << 30
    descriptors: int = 1024
    processes: int = 256

    def paths(self) -> tuple[str, ...]:
        """All that it may read, `scratch` apart."""
        found = [*self.readable, *python_folders(), *library_folders(), *SYSTEM, *self.allowed.read]
        if self.allowed.execute:
            found += PROGRAMS
        if self.allowed.network or self.allowed.loopback:
            found += NAMES
        if self.allowed.network:
            found += CERTIFICATES
        return tuple(dict.fromkeys(found))

    def refusals(self, process: int, offer: Offer) -> dict[str, Refusal]:
        return refusals(
            process,
            network=self.allowed.network or self.allowed.loopback,
            execute=self.allowed.execute,
            truncate=0 < offer.landlock < TRUNCATE_ABI,
        )

    def gaps(self, offer: Offer) -> list[str]:
        """What this machine does not hold back, one sentence each."""
        found = offer.gaps()
        if self.allowed.execute and offer.seccomp and offer.landlock < SIGNAL_ABI:
            found.append("signals: with exec granted, an FMU may stop and kill your processes")
        return found


@lru_cache(maxsize=1)
def python_folders() -> tuple[str, ...]:
    """This Python, its packages and this one; not the other folders of its search path."""
    places = {sys.prefix, sys.base_prefix, sys.exec_prefix, sys.base_exec_prefix}
    places |= {str(Path(__file__).parent.parent), os.path.dirname(os.__file__)}
    of_packages = [p for p in sys.path if Path(p).name in ("site-packages", "dist-packages", "lib-dynload")]
    places.update(of_packages, *map(_linked, of_packages))
    return tuple(sorted(place for place in places if os.path.isdir(place)))


def _linked(folder: str) -> list[str]:
    """Where the packages of a folder lie that are linked into it: as a whole, or file by file (uv's link mode)."""
    found = []
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if entry.is_symlink():
                found.append(os.path.realpath(entry.path))
            elif entry.name.endswith(".dist-info") and os.path.islink(own := os.path.join(entry.path, "METADATA")):
                found.append(os.path.dirname(os.path.dirname(os.path.realpath(own))))
    return found


@lru_cache(maxsize=1)
def library_folders() -> tuple[str, ...]:
    """Where the dynamic linker looks."""
    places = [*LIBRARIES, *STORES, *os.environ.get("LD_LIBRARY_PATH", "").split(":")]
    with contextlib.suppress(OSError):
        for name in sorted(os.listdir(LINKER)):
            if name.endswith(".conf"):
                with open(os.path.join(LINKER, name), encoding="utf-8", errors="replace") as file:
                    places += [line.strip() for line in file]
    return tuple(dict.fromkeys(place for place in places if os.path.isabs(place) and os.path.isdir(place)))


def enter(confinement: Confinement, report: socket.socket | None = None) -> list[str]:
    """Closes the sandbox around this process and all that it will start, for good; returns what is not held back.
    Called before foreign code is loaded, by a process of one thread. With `report` each refused and each notable call
    is announced there, see `watch`.

    Raises EnvironmentProblem where what is granted cannot be had without more, or the kernel refuses."""
    offer = offered()
    if not offer.landlock and not offer.seccomp:
        return confinement.gaps(offer)
    try:
        threads = len(os.listdir("/proc/self/task"))
        if threads != 1:
            raise EnvironmentProblem(f"the sandbox must be entered before threads start; there are {threads}")
        if confinement.allowed.loopback and not confinement.allowed.network:
            _own_network(offer)
        _limit(confinement)
        _drop_capabilities()
        checked(prctl(NO_NEW_PRIVILEGES, 1), "no_new_privs")
        if offer.landlock:
            landlock.restrict(
                offer.landlock,
                confinement.paths(),
                (confinement.scratch, "/dev/null"),
                network=confinement.allowed.network or confinement.allowed.loopback,
                execute=confinement.allowed.execute,
            )
        if offer.seccomp:
            _filter(confinement, offer, report)
    except OSError as problem:
        raise EnvironmentProblem(f"the sandbox cannot be closed: {problem.strerror or problem}") from None
    return confinement.gaps(offer)


def _filter(confinement: Confinement, offer: Offer, report: socket.socket | None) -> None:
    refused = confinement.refusals(os.getpid(), offer)
    if report is not None:
        with contextlib.suppress(OSError):  # a kernel without listeners: the sandbox holds, nothing is announced
            listener = seccomp.install(seccomp.compiled(refused, WATCHED), listener=True)
            socket.send_fds(report, [b"l"], [listener])
            os.close(listener)
            return
    seccomp.install(seccomp.compiled(refused))


def _limit(confinement: Confinement) -> None:
    import resource

    limits = [(resource.RLIMIT_FSIZE, confinement.largest), (resource.RLIMIT_NOFILE, confinement.descriptors)]
    if confinement.allowed.execute and os.geteuid() != 0:  # the kernel counts all processes of the user
        limits.append((resource.RLIMIT_NPROC, _processes_of_the_user() + confinement.processes))
    for kind, value in [*limits, (resource.RLIMIT_CORE, 0)]:
        hard = resource.getrlimit(kind)[1]
        least = value if hard == resource.RLIM_INFINITY else min(value, hard)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (least, least))


def _processes_of_the_user() -> int:
    count, me = 0, os.getuid()
    for entry in os.scandir("/proc"):
        with contextlib.suppress(OSError):
            if entry.name.isdigit() and entry.stat().st_uid == me:
                count += len(os.listdir(f"/proc/{entry.name}/task"))
    return count


def _drop_capabilities() -> None:
    """All but reading the files of others, which Landlock governs; a user who has none loses none."""
    held = _capabilities()
    if not held:
        return
    for capability in range(CAPABILITIES):
        if capability != READ_ANY_FILE and prctl(DROP_CAPABILITY, capability) != 0 and capability > MANAGE_MACHINE:
            break  # the kernel knows no more of them
    prctl(AMBIENT, CLEAR_ALL)
    keep = (1 << READ_ANY_FILE) & held
    header = ctypes.create_string_buffer(struct.pack("<II", 0x20080522, 0), 8)  # _LINUX_CAPABILITY_VERSION_3
    data = ctypes.create_string_buffer(struct.pack("<6I", keep, keep, 0, 0, 0, 0), 24)
    checked(libc().capset(header, data), "capset")


def _capabilities() -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next((int(line.removeprefix("CapEff:"), 16) for line in lines if line.startswith("CapEff:")), 0)


def _own_network(offer: Offer) -> None:
    """A network namespace with nothing in it but a loopback interface of its own."""
    import fcntl

    if not offer.namespaces:
        raise EnvironmentProblem(
            'allow = ["loopback"]: this machine cannot give a process a network of its own (user namespaces are off); '
            'allow = ["network"] grants the whole network instead'
        )
    death = ctypes.c_int(0)
    prctl(GET_DEATH_SIGNAL, ctypes.addressof(death))
    user, group = os.geteuid(), os.getegid()
    alone = not (_capabilities() >> MANAGE_MACHINE) & 1
    if libc().unshare(NEW_NETWORK | (NEW_USER if alone else 0)) != 0:
        raise EnvironmentProblem(
            f'allow = ["loopback"]: this machine refuses a process a network of its own '
            f'({os.strerror(ctypes.get_errno())}); allow = ["network"] grants the whole network instead'
        )
    if alone:
        for name, text in (("setgroups", "deny"), ("uid_map", f"{user} {user} 1"), ("gid_map", f"{group} {group} 1")):
            Path("/proc/self", name).write_text(text)
    if death.value:
        prctl(1, death.value)  # a change of credentials clears it
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
        request = struct.pack("<16sH14x", b"lo", 0)
        flags = struct.unpack("<16sH14x", fcntl.ioctl(wire, GET_INTERFACE_FLAGS, request))[1]
        fcntl.ioctl(wire, SET_INTERFACE_FLAGS, struct.pack("<16sH14x", b"lo", flags | UP))
