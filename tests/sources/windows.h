/* What faulty.c and its like ask of POSIX, for a compiler for Windows. */
#ifdef _WIN32
#include <signal.h>
__declspec(dllimport) void __stdcall Sleep(unsigned long milliseconds);
static inline int pause(void) { Sleep(1000); return 0; }
static inline int fork(void) { return -1; }
#define raise(signal) (*(volatile int *)0 = 0) /* Windows knows no signals */
#endif
