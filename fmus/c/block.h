/* What the C of a block stands on: Python's arithmetic where it is not C's, failures, text, and what
   the FMI wrapper is told of the block. C99, but for thread-local storage. */
#ifndef DESAT_BLOCK_H
#define DESAT_BLOCK_H

#include <math.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined(_MSC_VER)
#define PY_THREAD __declspec(thread)
#define PY_APART __declspec(noinline)
#define PY_NORETURN __declspec(noreturn)
#define PY_RARE(x) (x)
#else
#define PY_THREAD _Thread_local
#define PY_APART __attribute__((noinline))
#define PY_NORETURN __attribute__((noreturn, cold))
#define PY_RARE(x) __builtin_expect(!!(x), 0)
#endif

/* --- failures: Python's exceptions ------------------------------------------------------------- */

enum {
    PY_BLOCK_ERROR, PY_VALUE_ERROR, PY_ZERO_DIVISION, PY_OVERFLOW, PY_INDEX_ERROR, PY_TYPE_ERROR,
    PY_RUNTIME_ERROR, PY_STOP_ITERATION
};

typedef struct py_frame {
    jmp_buf jump;
    struct py_frame *outer;
} py_frame;

void py_try(py_frame *frame);
void py_end_try(void);
#define PY_TRY(frame) (py_try(&(frame)), setjmp((frame).jump) == 0)

PY_NORETURN void py_raise(int kind, const char *text);
PY_NORETURN void py_raise_again(void);
PY_NORETURN void py_no_value(void);
PY_NORETURN void py_zero_division(const char *text);
PY_NORETURN void py_index_error(void);
PY_NORETURN void py_too_long(int64_t most);
PY_NORETURN void py_unpack_error(int64_t n, int64_t wanted);
PY_NORETURN void py_beyond(void);
PY_NORETURN void py_not_integer(double x);
void py_recursion(void);
bool py_caught(int kinds);
const char *py_caught_text(void);
const char *py_caught_name(void);

/* --- text, for messages and the keys of noise --------------------------------------------------- */

void py_text_begin(void);
void py_text(const char *text);
void py_text_float(double x);
void py_text_int(int64_t x);
void py_text_mask(uint64_t x);
void py_text_format(char kind, int precision, double x);
const char *py_text_end(void);

/* --- floats -------------------------------------------------------------------------------------- */

double py_sin(double x);
double py_cos(double x);
double py_tan(double x);
double py_asin(double x);
double py_acos(double x);
double py_atan(double x);
double py_exp(double x);
double py_expm1(double x);
double py_log(double x);
double py_log10(double x);
double py_log2(double x);
double py_log1p(double x);
double py_sinh(double x);
double py_cosh(double x);
double py_tanh(double x);
double py_atan2(double y, double x);
double py_remainder(double x, double y);
double py_fmod(double x, double y);
double py_pow(double x, double y);
double py_mod(double x, double y);
double py_floordiv(double x, double y);
PY_NORETURN void py_domain(void);
int64_t py_bisect_right(const double *a, int64_t n, double x);
int64_t py_bisect_left(const double *a, int64_t n, double x);

static inline double py_sqrt(double x)
{
    if (PY_RARE(x < 0.0)) py_domain();
    return sqrt(x);
}

static inline double py_div(double a, double b)
{
    if (PY_RARE(b == 0.0)) py_zero_division("float division by zero");
    return a / b;
}

static inline double py_div_int(double a, double b)
{
    if (PY_RARE(b == 0.0)) py_zero_division("division by zero");
    return a / b;
}

static inline double py_min(double a, double b) { return b < a ? b : a; }
static inline double py_max(double a, double b) { return b > a ? b : a; }
static inline int64_t py_min_i(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t py_max_i(int64_t a, int64_t b) { return b > a ? b : a; }

/* --- integers: 64 bits, and a failure beyond ----------------------------------------------------- */

static inline int64_t py_add_i(int64_t a, int64_t b)
{
    if (PY_RARE(b > 0 ? a > INT64_MAX - b : a < INT64_MIN - b)) py_beyond();
    return a + b;
}

static inline int64_t py_sub_i(int64_t a, int64_t b)
{
    if (PY_RARE(b < 0 ? a > INT64_MAX + b : a < INT64_MIN + b)) py_beyond();
    return a - b;
}

int64_t py_mul_i(int64_t a, int64_t b);
int64_t py_mod_i(int64_t a, int64_t b);
int64_t py_floordiv_i(int64_t a, int64_t b);
double py_div_i(int64_t a, int64_t b);

static inline int64_t py_abs_i(int64_t a) { return a < 0 ? py_sub_i(0, a) : a; }

/* an integer where Python would go on beyond 64 bits of a mask */
static inline uint64_t py_mask(int64_t a)
{
    if (PY_RARE(a < 0)) py_beyond();
    return (uint64_t)a;
}

/* an integer compared with a float: of the same value, or a failure */
static inline double py_exact(int64_t a)
{
    if (PY_RARE(a > INT64_C(1) << 53 || a < -(INT64_C(1) << 53))) py_beyond();
    return (double)a;
}

static inline double py_finite(double x)
{
    if (PY_RARE(!isfinite(x))) py_not_integer(x);
    return x;
}

static inline int64_t py_integer(double x)
{
    if (PY_RARE(!(x >= -9223372036854775808.0 && x < 9223372036854775808.0))) {
        py_finite(x);
        py_beyond();
    }
    return (int64_t)x;
}

/* an integer as a float, without a limit; + 0.0 as there is no integer -0 */
static inline double py_floor_f(double x) { return floor(py_finite(x)) + 0.0; }
static inline double py_ceil_f(double x) { return ceil(py_finite(x)) + 0.0; }
static inline double py_trunc_f(double x) { return trunc(py_finite(x)) + 0.0; }
static inline double py_rint_f(double x) { return nearbyint(py_finite(x)) + 0.0; }
static inline int64_t py_floor(double x) { return py_integer(floor(x)); }
static inline int64_t py_ceil(double x) { return py_integer(ceil(x)); }
static inline int64_t py_trunc(double x) { return py_integer(x); }
static inline int64_t py_rint(double x) { return py_integer(nearbyint(x)); }

/* --- tuples -------------------------------------------------------------------------------------- */

static inline int64_t py_index(int64_t i, int64_t n)
{
    if (PY_RARE(i < 0)) i += n;
    if (PY_RARE(i < 0 || i >= n)) py_index_error();
    return i;
}

static inline void py_window(int64_t first, int64_t count, int64_t n)
{
    if (PY_RARE(first < 0 || first > n - count)) py_index_error();
}

static inline int64_t py_bound(int64_t i, int64_t n)
{
    if (i < 0) i += n;
    return i < 0 ? 0 : i > n ? n : i;
}

static inline int64_t py_count(int64_t first, int64_t end) { return end > first ? end - first : 0; }

static inline int64_t py_count_by(int64_t first, int64_t end, int64_t step)
{
    if (step > 0) return end > first ? (end - first - 1) / step + 1 : 0;
    return first > end ? (first - end - 1) / -step + 1 : 0;
}

/* the place of one more in a tuple of at most `most` */
static inline int64_t py_room(int64_t k, int64_t most)
{
    if (PY_RARE(k >= most)) py_too_long(most);
    return k;
}

static inline int64_t py_length(int64_t n, int64_t most)
{
    if (PY_RARE(n > most)) py_too_long(most);
    return n;
}

static inline void py_unpack(int64_t n, int64_t wanted)
{
    if (PY_RARE(n != wanted)) py_unpack_error(n, wanted);
}

static inline void py_same_length(int64_t a, int64_t b)
{
    if (PY_RARE(a != b)) py_raise(PY_VALUE_ERROR, "zip() arguments are of different lengths");
}

static inline void py_some(bool some)
{
    if (PY_RARE(!some)) py_no_value();
}

static inline void py_not_empty(bool some)
{
    if (PY_RARE(!some)) py_raise(PY_VALUE_ERROR, "min() or max() of nothing");
}

static inline void py_next(bool some)
{
    if (PY_RARE(!some)) py_raise(PY_STOP_ITERATION, "");
}

static inline void py_found(int64_t k)
{
    if (PY_RARE(k < 0)) py_raise(PY_VALUE_ERROR, "tuple.index(x): x not in tuple");
}

/* --- what a block is ------------------------------------------------------------------------------ */

typedef struct {
    const char *name;
    size_t offset;  /* in the block */
    char kind;      /* R: double, I: int64_t, B: bool */
    char causality; /* i, o, p */
    double low, high;
    const char *bounds;
} block_variable;

typedef struct block_description {
    const char *name, *guid;
    size_t size;
    const struct block_description *const *parts; /* of a loop: the blocks that it is made of, whose
                                                     bytes follow its own, each with its block_room */
    size_t part_count;
    const void *at_start;
    const block_variable *variables; /* by value reference */
    size_t count;
    size_t fault; /* where the output of that name is */
    void (*start)(void *self);
    void (*output)(void *self, double t);
    void (*advance)(void *self, double t, double dt);
} block_description;

/* A block begins with `const char *instance`; all else in it is plain numbers, so that its bytes
   are its state. */
extern const block_description desat_the_block;

static inline size_t block_room(size_t size) { return (size + 15) / 16 * 16; }

#endif
