"""Windows, by its own interface (kernel32) and what Python has of it.

A child and all that it starts belong to a job object, which the system ends when the last handle to it is closed: with
its parent, whatever becomes of that. Run under wine so far, see docs/platforms.md."""

from __future__ import annotations

import contextlib
import ctypes
import math
import msvcrt
import os
import queue
import re
import shutil
import stat
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from ctypes import wintypes
from pathlib import Path
from time import monotonic, process_time, sleep
from typing import Any

from .face import Ending, Pipe

assert sys.platform == "win32"

EXTENDED_LIMITS = 9  # JobObjectExtendedLimitInformation
KILL_ON_CLOSE, PROCESS_MEMORY, NO_DIALOGUE = 0x2000, 0x100, 0x400  # JOB_OBJECT_LIMIT_...
SET_QUOTA_AND_TERMINATE = 0x0101  # rights to a process
SILENT = 0x0001 | 0x0002 | 0x8000  # SEM_FAILCRITICALERRORS, _NOGPFAULTERRORBOX, _NOOPENFILEERRORBOX
ENDED = 0xE0000001  # exit codes that nothing else has: ended by its parent,
OVERRAN = 0xE0000002  # over its processor time
CONDITIONS = {  # NTSTATUS, as an exit code
    0xC0000005: "an access violation",
    0xC0000006: "a page that could not be read",
    0xC000001D: "an illegal instruction",
    0xC0000025: "an exception that cannot be continued",
    0xC000008E: "a division by zero",
    0xC0000094: "an integer division by zero",
    0xC00000FD: "a stack overflow",
    0xC0000135: "a missing DLL",
    0xC0000139: "a function missing in a DLL",
    0xC0000374: "a corrupted heap",
    0xC0000409: "a stack buffer overrun or a call of abort",
    0x40000015: "a call of abort",
}
FAULTS = {  # what ctypes makes of them
    "exception: access violation": 0xC0000005,
    "exception: stack overflow": 0xC00000FD,
    "exception: datatype misalignment": 0x80000002,
}
LOCKED = 1 << 30  # place of the byte that is locked; what is locked cannot be read, and the holder's number must be
RETRIES, PAUSE = 20, 0.05  # s, for a file that a virus scanner or an indexer has open
DEVICES = {
    "con",
    "prn",
    "aux",
    "nul",
    "conin$",
    "conout$",
    *(f"{d}{k}" for d in ("com", "lpt") for k in "123456789¹²³"),
}
FORBIDDEN = '<>:"|?*'
LONGEST = 259  # characters of a path, unless long paths are switched on
EXTENDED = "\\\\?\\"  # before a path: as it is
PLAIN = re.compile(r"[\w.:/\\@+=-]+")  # a word that needs no quotation marks
SLICE = 0.1  # s


class _Counters(ctypes.Structure):
    _fields_ = [(f"count_{k}", ctypes.c_uint64) for k in range(6)]


class _Limits(ctypes.Structure):
    """JOBOBJECT_EXTENDED_LIMIT_INFORMATION."""

    _fields_ = [
        ("process_time", ctypes.c_int64),
        ("job_time", ctypes.c_int64),
        ("flags", wintypes.DWORD),
        ("least_set", ctypes.c_size_t),
        ("most_set", ctypes.c_size_t),
        ("processes", wintypes.DWORD),
        ("affinity", ctypes.c_size_t),
        ("priority", wintypes.DWORD),
        ("scheduling", wintypes.DWORD),
        ("counters", _Counters),
        ("process_memory", ctypes.c_size_t),
        ("job_memory", ctypes.c_size_t),
        ("peak_process_memory", ctypes.c_size_t),
        ("peak_job_memory", ctypes.c_size_t),
    ]


class _Memory(ctypes.Structure):
    """PROCESS_MEMORY_COUNTERS."""

    _fields_ = [
        ("size", wintypes.DWORD),
        ("faults", wintypes.DWORD),
        *((name, ctypes.c_size_t) for name in ("peak_set", "set", "a", "b", "c", "d", "pages", "peak_pages")),
    ]


def _kernel() -> Any:
    found = ctypes.WinDLL("kernel32", use_last_error=True)
    for name in ("CreateJobObjectW", "OpenProcess", "GetCurrentProcess"):
        getattr(found, name).restype = wintypes.HANDLE
    found.CreateJobObjectW.argtypes = [ctypes.c_void_p, wintypes.LPCWSTR]
    found.OpenProcess.argtypes = [wintypes.DWORD, wintypes.BOOL, wintypes.DWORD]
    found.SetInformationJobObject.argtypes = [wintypes.HANDLE, ctypes.c_int, ctypes.c_void_p, wintypes.DWORD]
    found.AssignProcessToJobObject.argtypes = [wintypes.HANDLE, wintypes.HANDLE]
    found.TerminateJobObject.argtypes = [wintypes.HANDLE, wintypes.UINT]
    found.TerminateProcess.argtypes = [wintypes.HANDLE, wintypes.UINT]
    found.CloseHandle.argtypes = [wintypes.HANDLE]
    found.K32GetProcessMemoryInfo.argtypes = [wintypes.HANDLE, ctypes.c_void_p, wintypes.DWORD]
    return found


class Windows:
    """Implements System."""

    stops = ("SIGINT", "SIGTERM", "SIGBREAK")
    patience = SLICE  # a lock that the main thread waits for is not left for a Ctrl-C
    compiler = "install the Build Tools for Visual Studio with C++, or mingw-w64 with its folder bin on the PATH"
    mingw = "install it and put its folder bin on the PATH (MSYS2: pacman -S mingw-w64-ucrt-x86_64-gcc)"

    def __init__(self) -> None:
        self._kernel = _kernel()
        self._allowed: float | None = None  # s of processor time, since this process began

    def options(self, passed: Sequence[int] = ()) -> dict[str, Any]:
        for descriptor in passed:
            os.set_handle_inheritable(self.name_of(descriptor), True)
        information = subprocess.STARTUPINFO(lpAttributeList={"handle_list": [self.name_of(d) for d in passed]})
        flags = subprocess.CREATE_NO_WINDOW | subprocess.CREATE_NEW_PROCESS_GROUP
        return {"startupinfo": information, "creationflags": flags, **_program()}

    def variables(self, scratch: str) -> dict[str, str]:
        launched = {"__PYVENV_LAUNCHER__": sys.executable} if _program() else {}
        return dict.fromkeys(("TMPDIR", "TEMP", "TMP"), scratch) | launched

    def name_of(self, descriptor: int) -> int:
        return msvcrt.get_osfhandle(descriptor)

    def group(self, process: subprocess.Popen[bytes], memory: int = 0) -> Callable[[], None]:
        job = self._kernel.CreateJobObjectW(None, None)
        limits = _Limits(flags=KILL_ON_CLOSE | NO_DIALOGUE | (PROCESS_MEMORY if memory else 0), process_memory=memory)
        self._kernel.SetInformationJobObject(job, EXTENDED_LIMITS, ctypes.byref(limits), ctypes.sizeof(limits))
        handle = self._kernel.OpenProcess(SET_QUOTA_AND_TERMINATE, False, process.pid)
        held = bool(job and handle and self._kernel.AssignProcessToJobObject(job, handle))
        if handle:
            self._kernel.CloseHandle(handle)

        def end() -> None:
            if held:
                self._kernel.TerminateJobObject(job, ENDED)
            with contextlib.suppress(OSError):
                process.kill()
            self._kernel.CloseHandle(job)
            process.wait()

        return end

    def ending(self, code: int) -> Ending:
        code &= 0xFFFFFFFF
        if code == OVERRAN:
            return Ending("timeout", "overran its limit of processor time and was ended")
        if code in CONDITIONS:
            return Ending("crashed", f"ended by {CONDITIONS[code]} (0x{code:08X})")
        if code >= 0x80000000:
            return Ending("crashed", f"ended by condition 0x{code:08X}")
        return Ending("crashed", f"ended its process with exit code {code}")

    def pipe(self, descriptor: int) -> Pipe:
        return _Pipe(descriptor)

    def opened(self, name: int, writes: bool) -> int:
        os.set_handle_inheritable(name, False)
        return msvcrt.open_osfhandle(name, os.O_WRONLY if writes else os.O_RDONLY)

    def confine(self, memory: int) -> None:
        self._kernel.SetErrorMode(SILENT)  # the memory is limited by the job

    def die_with(self, parent: int) -> None:
        pass  # the job does

    def end_by(self, problem: OSError) -> None:
        code = next((code for text, code in FAULTS.items() if str(problem).startswith(text)), None)
        if code is not None:
            self._end(code)

    def _end(self, code: int) -> None:
        self._kernel.TerminateProcess(self._kernel.GetCurrentProcess(), code)

    def allow_processor_time(self, seconds: float) -> None:
        first, self._allowed = self._allowed is None, process_time() + seconds
        if first:
            threading.Thread(target=self._watch, daemon=True).start()

    def _watch(self) -> None:
        while (left := (self._allowed or 0.0) - process_time()) > 0:
            sleep(max(SLICE, left / (os.cpu_count() or 1)))
        self._end(OVERRAN)

    def resident(self) -> int:
        found = _Memory(size=ctypes.sizeof(_Memory))
        own = self._kernel.GetCurrentProcess()
        return int(found.peak_set) if self._kernel.K32GetProcessMemoryInfo(own, ctypes.byref(found), found.size) else 0

    def cores(self) -> int:
        return os.cpu_count() or 1

    def quoted(self, word: str) -> str:
        return word if word and PLAIN.fullmatch(word) else f'"{word}"'

    def lock(self, descriptor: int) -> bool:
        os.lseek(descriptor, LOCKED, os.SEEK_SET)
        try:
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        finally:
            os.lseek(descriptor, 0, os.SEEK_SET)
        return True

    def refusal(self, path: Path, inside: int = 0) -> str:
        for part in path.parts[1:] if path.anchor else path.parts:
            if part.partition(".")[0].rstrip(" ").lower() in DEVICES:
                return f"{part!r} is the name of a device on Windows; choose another"
            if any(c in FORBIDDEN or ord(c) < 32 for c in part):
                return f"{part!r} holds a character that Windows has in no name ({' '.join(FORBIDDEN)}); choose another"
            if part not in (".", "..") and part.endswith((".", " ")):
                return f"{part!r} ends with a point or a blank, which Windows drops; choose another name"
        length = len(str(path.absolute())) + inside
        if length > LONGEST and not str(path).startswith(EXTENDED) and not _long_paths():
            files = " with the files in it" if inside else ""
            return f"{length} characters{files}, more than the {LONGEST} that Windows accepts; choose a shorter folder"
        return ""

    def rename(self, source: Path, target: Path) -> None:
        for last in _attempts():
            try:
                os.replace(source, target)
                return
            except PermissionError:
                if target.is_dir() or last:
                    raise
                with contextlib.suppress(OSError):
                    target.chmod(stat.S_IWRITE)  # what is protected from writing is not replaced

    def remove(self, file: Path) -> None:
        for last in _attempts():
            try:
                file.unlink(missing_ok=True)
                return
            except PermissionError:
                if last:
                    raise
                with contextlib.suppress(OSError):
                    file.chmod(stat.S_IWRITE)

    def remove_tree(self, folder: Path | str) -> None:
        for _ in _attempts():
            for place, _, files in os.walk(folder):
                for name in files:
                    with contextlib.suppress(OSError):
                        os.chmod(os.path.join(place, name), stat.S_IWRITE)
            shutil.rmtree(folder, ignore_errors=True)
            if not os.path.exists(folder):
                return

    def caches(self) -> Path:
        local = os.environ.get("LOCALAPPDATA")
        return Path(local) if local else Path.home() / "AppData" / "Local"


def _program() -> dict[str, str]:
    """In a virtual environment: the Python that its python.exe would start as a process of its own."""
    base = getattr(sys, "_base_executable", sys.executable)
    return {} if os.path.normcase(base) == os.path.normcase(sys.executable) else {"executable": base}


def _attempts() -> Iterator[bool]:
    """Whether it is the last."""
    for k in range(RETRIES):
        yield k == RETRIES - 1
        sleep(PAUSE)


def _long_paths() -> bool:
    import winreg

    with (
        contextlib.suppress(OSError),
        winreg.OpenKey(winreg.HKEY_LOCAL_MACHINE, r"SYSTEM\CurrentControlSet\Control\FileSystem") as key,
    ):
        return bool(winreg.QueryValueEx(key, "LongPathsEnabled")[0])
    return False


class _Pipe:
    """A pipe cannot be waited for with a limit: a thread reads it as soon as somebody does."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._pieces: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._rest = b""

    def read(self, count: int, seconds: float) -> bytes:
        if self._thread is None:
            if seconds == math.inf:
                return os.read(self._descriptor, count)
            self._thread = threading.Thread(target=self._fetch, daemon=True)
            self._thread.start()
        if not self._rest:
            self._rest = self._next(monotonic() + seconds)
        piece, self._rest = self._rest[:count], self._rest[count:]
        return piece

    def close(self) -> None:
        if self._thread is not None:
            self._thread.join(1.0)
        if self._thread is None or not self._thread.is_alive():  # closing what is being read waits for the reading
            os.close(self._descriptor)

    def _next(self, deadline: float) -> bytes:
        while True:
            left = deadline - monotonic()
            try:
                piece = self._pieces.get(timeout=min(SLICE, max(0.0, left)))
            except queue.Empty:
                if left <= 0:
                    raise TimeoutError from None
                continue
            if not piece:
                self._pieces.put(piece)
            return piece

    def _fetch(self) -> None:
        piece = b"?"
        while piece:
            try:
                piece = os.read(self._descriptor, 1 << 16)
            except OSError:
                piece = b""
            self._pieces.put(piece)
