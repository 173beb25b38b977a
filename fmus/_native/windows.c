/* On Windows: what the compiled device calls and the system's C library lacks. mingw-w64's own is of the x87 unit, which is slow, and wrong near multiples of pi. */

#include <math.h>

void sincos(double x, double *sine, double *cosine) {
    *sine = sin(x);
    *cosine = cos(x);
}
