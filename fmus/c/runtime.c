/* Python's arithmetic, text and exceptions, for the C of a block. A file of its own, so that no
   compiler computes a function of libm itself: it would round otherwise. */

#include "block.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>

/* --- failures ----------------------------------------------------------------------------------- */

enum { PY_DEEPEST = 256 << 10 };

static PY_THREAD py_frame *py_top, *py_first;
static PY_THREAD int py_kind_caught;
static PY_THREAD char py_text_caught[1000];

static const char *const PY_NAMES[] = {
    "BlockError", "ValueError", "ZeroDivisionError", "OverflowError", "IndexError", "TypeError",
    "RuntimeError", "StopIteration"
};

void py_try(py_frame *frame)
{
    if (py_top == NULL) py_first = frame;
    frame->outer = py_top;
    py_top = frame;
}

/* a function that calls itself, before it takes the host's stack */
void py_recursion(void)
{
    const char here = 0;
    const intptr_t deep = (intptr_t)&here - (intptr_t)py_first;
    if (PY_RARE(deep > PY_DEEPEST || deep < -PY_DEEPEST))
        py_raise(PY_RUNTIME_ERROR, "maximum recursion depth exceeded");
}

void py_end_try(void) { py_top = py_top->outer; }

void py_raise(int kind, const char *text)
{
    py_kind_caught = kind;
    if (text != py_text_caught) snprintf(py_text_caught, sizeof py_text_caught, "%s", text);
    py_raise_again();
}

void py_raise_again(void)
{
    py_frame *frame = py_top;
    py_top = frame->outer;
    longjmp(frame->jump, 1);
}

bool py_caught(int kinds) { return (kinds >> py_kind_caught & 1) != 0; }
const char *py_caught_text(void) { return py_text_caught; }
const char *py_caught_name(void) { return PY_NAMES[py_kind_caught]; }

void py_no_value(void) { py_raise(PY_TYPE_ERROR, "a value is None"); }
void py_zero_division(const char *text) { py_raise(PY_ZERO_DIVISION, text); }
void py_index_error(void) { py_raise(PY_INDEX_ERROR, "tuple index out of range"); }
void py_beyond(void) { py_raise(PY_OVERFLOW, "an integer beyond 64 bits"); }
void py_domain(void) { py_raise(PY_VALUE_ERROR, "math domain error"); }

void py_too_long(int64_t most)
{
    char text[80];
    snprintf(text, sizeof text, "a tuple of more than %lld elements", (long long)most);
    py_raise(PY_OVERFLOW, text);
}

void py_unpack_error(int64_t n, int64_t wanted)
{
    char text[100];
    if (n < wanted)
        snprintf(text, sizeof text, "not enough values to unpack (expected %lld, got %lld)",
                 (long long)wanted, (long long)n);
    else
        snprintf(text, sizeof text, "too many values to unpack (expected %lld)", (long long)wanted);
    py_raise(PY_VALUE_ERROR, text);
}

void py_not_integer(double x)
{
    if (isnan(x)) py_raise(PY_VALUE_ERROR, "cannot convert float NaN to integer");
    py_raise(PY_OVERFLOW, "cannot convert float infinity to integer");
}

/* --- text: several may be in use at a time, each up to LONGEST ----------------------------------- */

enum { PY_LONGEST = 1000, PY_ROOM = 8000 };

static PY_THREAD char py_texts[PY_ROOM];
static PY_THREAD int py_begun, py_at;

void py_text_begin(void)
{
    if (py_at > PY_ROOM - PY_LONGEST) py_at = 0;
    py_begun = py_at;
    py_texts[py_at] = 0;
}

void py_text(const char *text)
{
    while (*text && py_at < py_begun + PY_LONGEST - 1) py_texts[py_at++] = *text++;
    py_texts[py_at] = 0;
}

const char *py_text_end(void)
{
    py_at++;
    return py_texts + py_begun;
}

void py_text_int(int64_t x)
{
    char text[24];
    snprintf(text, sizeof text, "%lld", (long long)x);
    py_text(text);
}

void py_text_mask(uint64_t x)
{
    char text[24];
    snprintf(text, sizeof text, "%llu", (unsigned long long)x);
    py_text(text);
}

static bool py_special(double x)
{
    if (isnan(x)) py_text("nan");
    else if (isinf(x)) py_text(x > 0.0 ? "inf" : "-inf");
    else return false;
    return true;
}

void py_text_format(char kind, int precision, double x)
{
    char text[400], format[] = "%.*g";
    if (py_special(x)) return;
    format[3] = kind;
    snprintf(text, sizeof text, format, precision, x);
    py_text(text);
}

/* one more in the last digit: below a power of two numbers lie closer, so that the nearest decimal
   may be another number, and the next one not */
static void py_increased(char *text)
{
    char *last = strchr(text, 'e') - 1;
    while (last > text && *last == '9') last--;
    if (*last >= '0' && *last < '9') ++*last;
    while (*++last != 'e') *last = '0';
}

/* as repr: the fewest digits that give the same number again */
void py_text_float(double x)
{
    char text[40], digits[20], out[64];
    int precision, exponent, n = 0, k = 0;
    if (py_special(x)) return;
    for (precision = 0; precision < 17; precision++) {
        snprintf(text, sizeof text, "%.*e", precision, x);
        if (strtod(text, NULL) == x) break;
        py_increased(text);
        if (strtod(text, NULL) == x) break;
    }
    for (const char *c = text; *c && *c != 'e'; c++)
        if (*c >= '0' && *c <= '9') digits[n++] = *c;
    while (n > 1 && digits[n - 1] == '0') n--;
    exponent = atoi(strchr(text, 'e') + 1);
    if (signbit(x)) out[k++] = '-';
    if (exponent < -4 || exponent >= 16) {
        out[k++] = digits[0];
        if (n > 1) out[k++] = '.';
        for (int i = 1; i < n; i++) out[k++] = digits[i];
        snprintf(out + k, sizeof out - (size_t)k, "e%c%02d", exponent < 0 ? '-' : '+',
                 abs(exponent));
        py_text(out);
        return;
    }
    if (exponent < 0) {
        out[k++] = '0';
        out[k++] = '.';
        for (int i = -1; i > exponent; i--) out[k++] = '0';
        for (int i = 0; i < n; i++) out[k++] = digits[i];
    } else {
        for (int i = 0; i <= exponent; i++) out[k++] = i < n ? digits[i] : '0';
        out[k++] = '.';
        if (n <= exponent + 1) out[k++] = '0';
        for (int i = exponent + 1; i < n; i++) out[k++] = digits[i];
    }
    out[k] = 0;
    py_text(out);
}

/* --- floats -------------------------------------------------------------------------------------- */

/* the result of a function of libm: Python says where there is none */
static double py_checked(double x, double r, bool may_overflow)
{
    if (PY_RARE(!isfinite(r))) {
        if (isnan(r) && !isnan(x)) py_domain();
        if (isinf(r) && isfinite(x)) {
            if (may_overflow) py_raise(PY_OVERFLOW, "math range error");
            py_domain();
        }
    }
    return r;
}

double py_sin(double x) { return py_checked(x, sin(x), false); }
double py_cos(double x) { return py_checked(x, cos(x), false); }
double py_tan(double x) { return py_checked(x, tan(x), false); }
double py_asin(double x) { return py_checked(x, asin(x), false); }
double py_acos(double x) { return py_checked(x, acos(x), false); }
double py_atan(double x) { return py_checked(x, atan(x), false); }
double py_exp(double x) { return py_checked(x, exp(x), true); }
double py_expm1(double x) { return py_checked(x, expm1(x), true); }
double py_log1p(double x) { return py_checked(x, log1p(x), false); }
double py_sinh(double x) { return py_checked(x, sinh(x), true); }
double py_cosh(double x) { return py_checked(x, cosh(x), true); }
double py_tanh(double x) { return py_checked(x, tanh(x), false); }

double py_log(double x)
{
    if (PY_RARE(x <= 0.0)) py_domain();
    return log(x);
}

double py_log10(double x)
{
    if (PY_RARE(x <= 0.0)) py_domain();
    return log10(x);
}

double py_log2(double x)
{
    if (PY_RARE(x <= 0.0)) py_domain();
    return log2(x);
}

double py_atan2(double y, double x) { return atan2(y, x); }

double py_remainder(double x, double y)
{
    if (PY_RARE((isinf(x) && !isnan(y)) || (y == 0.0 && !isnan(x)))) py_domain();
    return remainder(x, y);
}

double py_fmod(double x, double y)
{
    if (PY_RARE((isinf(x) && !isnan(y)) || (y == 0.0 && !isnan(x)))) py_domain();
    return fmod(x, y);
}

/* float_pow of CPython's floatobject.c, but a negative number to a fractional power is refused */
double py_pow(double x, double y)
{
    bool negate = false;
    double r;
    if (y == 0.0) return 1.0;
    if (isnan(x)) return x;
    if (isnan(y)) return x == 1.0 ? 1.0 : y;
    if (isinf(y)) {
        x = fabs(x);
        if (x == 1.0) return 1.0;
        return (y > 0.0) == (x > 1.0) ? fabs(y) : 0.0;
    }
    if (isinf(x)) {
        bool odd = fmod(fabs(y), 2.0) == 1.0;
        if (y > 0.0) return odd ? x : fabs(x);
        return odd ? copysign(0.0, x) : 0.0;
    }
    if (x == 0.0) {
        bool odd = fmod(fabs(y), 2.0) == 1.0;
        if (y < 0.0) py_raise(PY_ZERO_DIVISION, "0.0 cannot be raised to a negative power");
        return odd ? x : 0.0;
    }
    if (x < 0.0) {
        if (y != floor(y)) py_raise(PY_VALUE_ERROR, "a negative number to a fractional power");
        x = -x;
        negate = fmod(fabs(y), 2.0) == 1.0;
    }
    if (x == 1.0) return negate ? -1.0 : 1.0;
    errno = 0;
    r = pow(x, y);
    if (isinf(r) || (errno == ERANGE && r != 0.0))
        py_raise(PY_OVERFLOW, "(34, 'Numerical result out of range')");
    return negate ? -r : r;
}

double py_mod(double x, double y)
{
    double r;
    if (PY_RARE(y == 0.0)) py_zero_division("float modulo");
    r = fmod(x, y);
    if (r != 0.0) return (y < 0.0) != (r < 0.0) ? r + y : r;
    return copysign(0.0, y);
}

double py_floordiv(double x, double y)
{
    double r, d, f;
    if (PY_RARE(y == 0.0)) py_zero_division("float floor division by zero");
    r = fmod(x, y);
    d = (x - r) / y;
    if (r != 0.0 && (y < 0.0) != (r < 0.0)) d -= 1.0;
    if (d == 0.0) return copysign(0.0, x / y);
    f = floor(d);
    return d - f > 0.5 ? f + 1.0 : f;
}

int64_t py_bisect_right(const double *a, int64_t n, double x)
{
    int64_t low = 0, high = n;
    while (low < high) {
        int64_t middle = (low + high) / 2;
        if (x < a[middle]) high = middle;
        else low = middle + 1;
    }
    return low;
}

int64_t py_bisect_left(const double *a, int64_t n, double x)
{
    int64_t low = 0, high = n;
    while (low < high) {
        int64_t middle = (low + high) / 2;
        if (a[middle] < x) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* --- integers ------------------------------------------------------------------------------------ */

int64_t py_mul_i(int64_t a, int64_t b)
{
    if (a == 0 || b == 0) return 0;
    if ((a == -1 && b == INT64_MIN) || (b == -1 && a == INT64_MIN)) py_beyond();
    if (a > 0 ? (b > 0 ? a > INT64_MAX / b : b < INT64_MIN / a)
              : (b > 0 ? a < INT64_MIN / b : b < INT64_MAX / a))
        py_beyond();
    return a * b;
}

int64_t py_mod_i(int64_t a, int64_t b)
{
    int64_t r;
    if (b == 0) py_zero_division("integer division or modulo by zero");
    if (b == -1) return 0;
    r = a % b;
    return r != 0 && (r < 0) != (b < 0) ? r + b : r;
}

int64_t py_floordiv_i(int64_t a, int64_t b)
{
    if (b == 0) py_zero_division("integer division or modulo by zero");
    if (b == -1) return py_sub_i(0, a);
    return a / b - (a % b != 0 && (a < 0) != (b < 0));
}

double py_div_i(int64_t a, int64_t b)
{
    const int64_t exact = INT64_C(1) << 53;
    if (b == 0) py_zero_division("division by zero");
    if (a > exact || a < -exact || b > exact || b < -exact) py_beyond();
    return (double)a / (double)b;
}
