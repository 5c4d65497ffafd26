/* Failures end a call with their kind: there is no text, no heap, no output. */

typedef struct py_frame {
    jmp_buf jump;
    struct py_frame *outer;
} py_frame;

static py_frame *py_top, *py_first;
static int py_kind_caught;

enum { PY_DEEPEST = 256 << 10, PY_LONGEST = 1000 };

static void py_try(py_frame *frame)
{
    if (py_top == NULL) py_first = frame;
    frame->outer = py_top;
    py_top = frame;
}

#define PY_TRY(frame) (py_try(&(frame)), setjmp((frame).jump) == 0)

static void py_end_try(void) { py_top = py_top->outer; }

static PY_NORETURN void py_raise_again(void)
{
    py_frame *frame = py_top;
    py_top = frame->outer;
    longjmp(frame->jump, 1);
}

static PY_NORETURN void py_raise(int kind, const char *text)
{
    (void)text;
    py_kind_caught = kind;
    py_raise_again();
}

static void py_recursion(void)
{
    const char here = 0;
    const intptr_t deep = (intptr_t)&here - (intptr_t)py_first;
    if (PY_RARE(deep > PY_DEEPEST || deep < -PY_DEEPEST)) py_raise(PY_RUNTIME_ERROR, "");
}

static bool py_caught(int kinds) { return (kinds >> py_kind_caught & 1) != 0; }
static const char *py_caught_text(void) { return ""; }
static const char *py_caught_name(void) { return ""; }

static PY_NORETURN void py_no_value(void) { py_raise(PY_TYPE_ERROR, ""); }
static PY_NORETURN void py_zero_division(const char *text) { py_raise(PY_ZERO_DIVISION, text); }
static PY_NORETURN void py_index_error(void) { py_raise(PY_INDEX_ERROR, ""); }
static PY_NORETURN void py_beyond(void) { py_raise(PY_OVERFLOW, ""); }
static PY_NORETURN void py_domain(void) { py_raise(PY_VALUE_ERROR, ""); }
static PY_NORETURN void py_too_long(int64_t most) { (void)most; py_raise(PY_OVERFLOW, ""); }

static PY_NORETURN void py_unpack_error(int64_t n, int64_t wanted)
{
    (void)n, (void)wanted;
    py_raise(PY_VALUE_ERROR, "");
}

static PY_NORETURN void py_not_integer(double x)
{
    py_raise(isnan(x) ? PY_VALUE_ERROR : PY_OVERFLOW, "");
}

/* the keys of noise are texts; the numbers of messages are left out of them */
static char py_texts[PY_LONGEST];
static int py_at;

static void py_text_begin(void) { py_texts[py_at = 0] = 0; }

static void py_text(const char *text)
{
    while (*text && py_at < PY_LONGEST - 1) py_texts[py_at++] = *text++;
    py_texts[py_at] = 0;
}

static const char *py_text_end(void) { return py_texts; }
static void py_text_float(double x) { (void)x; }
static void py_text_int(int64_t x) { (void)x; }
static void py_text_mask(uint64_t x) { (void)x; }
static void py_text_format(char kind, int precision, double x) { (void)kind, (void)precision, (void)x; }
