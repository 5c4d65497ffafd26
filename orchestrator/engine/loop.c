/* The master's steps over function pointers of FMI 2.0 and FMI 3.0.
 *
 * It performs the operations of operations.py, in the same order and with the same roundings:
 * compiled.py converts them from the same plan. Schedules and rates are not known here.
 * Build it without contraction (-ffp-contract=off), or products and sums would be rounded only once.
 */
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#ifndef _WIN32
#include <unistd.h>
#endif

enum desat_code {
    DESAT_TICK, DESAT_LENGTH, DESAT_TAKE_8, DESAT_TAKE_4, DESAT_CONVERT, DESAT_TRANSFER,
    DESAT_STEP, DESAT_COPY, DESAT_CLEAR, DESAT_JOIN, DESAT_CUT, DESAT_PUT_R, DESAT_PUT_I,
    DESAT_PUT_B, DESAT_FETCH_R, DESAT_FETCH_I, DESAT_FETCH_B, DESAT_KEEP, DESAT_TRANSFER_3,
    DESAT_STEP_3, DESAT_TO_TYPE, DESAT_FROM_TYPE, DESAT_WIDEN
};

/* p and x by code:
 *   TICK      *p0 = start + (k + x0) step
 *   LENGTH    *p0 = x0
 *   TAKE_8/4  p0[p1[i]] = p2[p3[i]], values of 8 or 4 bytes
 *   CONVERT   p0[p1[i]] = p2[p3[i]] p4[i] + p5[i]
 *   WIDEN     the same, from integers of 4 bytes
 *   PUT, FETCH  set and get values of our own FMUs as in step mode: *p0[i] = p1[i], or back
 *   TRANSFER  function p0, component p1, value references p2, values p3
 *   STEP      function p0, component p1, time p2, length p3
 *   TRANSFER_3  FMI 3.0: as TRANSFER, with the number of values p4
 *   STEP_3      FMI 3.0: as STEP, with the outputs besides its status in p4
 *   TO_TYPE     p0[p1[i]] = p2[p3[i]], from a value of the loop to one of type p4 (fmi_versions.py,
 *             _CODES)
 *   FROM_TYPE   the reverse
 *   COPY      n bytes to p0 from p1
 *   CLEAR     n values of p0 become zero
 *   JOIN      for values p0 with means at p1 and slopes at p2: p3[i] += x0 mean,
 *             p4[i] += x1 mean + x2 slope
 *   CUT       for the same places: p0[p3[i]] = mean + x0 slope, p0[p4[i]] = x1 slope
 *   KEEP      row number p1 of p0, which has rows of n values, becomes p2[p3[i]]; p1 increases by one
 * A negative place means that there is none: its value is 0, and nothing is written there. */
struct desat_operation {
    int32_t code;
    int32_t more; /* a further call of the same verb follows */
    int64_t n;
    int64_t word; /* of a call: its word in current_call.py */
    void *p[6];
    double x[3];
};

struct desat_table {
    const char *source;
    char *rows;
    int64_t bytes; /* of a row */
};

enum desat_how { DESAT_NEVER, DESAT_BELOW, DESAT_ABOVE, DESAT_REACHES, DESAT_ALWAYS };

struct desat_loop {
    int64_t k;
    int64_t process; /* if a component may fork it: a call that returns in another process ends it */
    int64_t *word; /* of current_call.py: the current call of the process, and its time */
    double *time;
    double start, step;
    int64_t steps; /* of a cycle */
    const int64_t *edges; /* of step i: before its row from edges[2 i], after it from edges[2 i + 1] */
    const struct desat_operation *operations;
    /* a failure */
    int64_t failed;
    int64_t status;
    /* for each operation 1 + the step in which it first returned a warning, or 0; and the number of
     * new warnings */
    int64_t *warned;
    int64_t warnings;
    /* values that must be finite */
    const double *real;
    int64_t reals;
    /* rows */
    int64_t ahead, capacity;
    int64_t *taken;
    double *times;
    int64_t tables;
    struct desat_table table[3];
    /* when to evaluate the ending of the run; `asked`: the condition was met after the step before */
    int64_t how, watched, asked;
    const int64_t *places;
    const double *watched_reals;
    const int32_t *watched_integers;
    double limit;
};

enum desat_result { DESAT_LOOK, DESAT_FAILED, DESAT_NOT_FINITE };

/* unsigned: a status below 0, which FMI does not define, is not ok */
typedef unsigned desat_transfer(void *, const unsigned *, size_t, void *);
typedef unsigned desat_do_step(void *, double, double, int);

typedef unsigned desat_transfer_3(void *, const unsigned *, size_t, void *, size_t);
typedef unsigned desat_do_step_3(void *, double, double, bool, bool *, bool *, bool *, double *);

struct desat_done {
    bool event, terminate, early, whole;
    double last;
};
#define DESAT_NEAR 0.01 /* NEAR of fmi_versions.py */

/* Whether an integer is preserved by conversion to another type. */
#define DESAT_SAME(A, B) ((int64_t)(A) == (int64_t)(B) && ((A) < 0) == ((B) < 0))
#define DESAT_OURS(TYPE, KEEPS)                                                                     \
    for (i = 0; i < o->n; i++)                                                                      \
        if (from) {                                                                                 \
            const TYPE value = ((const TYPE *)o->p[2])[index[i]];                                   \
            if (!KEEPS(value, (int32_t)value)) return 3;                                            \
            ((int32_t *)o->p[0])[first[i]] = (int32_t)value;                                        \
        } else {                                                                                    \
            const int32_t value = ((const int32_t *)o->p[2])[index[i]];                             \
            if (!KEEPS(value, (TYPE)value)) return 3;                                               \
            ((TYPE *)o->p[0])[first[i]] = (TYPE)value;                                              \
        }                                                                                           \
    return 0;
#define DESAT_REALS(TYPE)                                                                           \
    for (i = 0; i < o->n; i++)                                                                      \
        if (from) ((double *)o->p[0])[first[i]] = ((const TYPE *)o->p[2])[index[i]];                \
        else ((TYPE *)o->p[0])[first[i]] = (TYPE)((const double *)o->p[2])[index[i]];               \
    return 0;
#define DESAT_ANY(A, B) true

static unsigned desat_typed(const struct desat_operation *o, bool from)
{
    const int64_t *first = o->p[1], *index = o->p[3];
    int64_t i;
    switch ((intptr_t)o->p[4]) {
    case 0: DESAT_REALS(float)
    case 1: DESAT_REALS(double)
    case 2: DESAT_OURS(int8_t, DESAT_SAME)
    case 3: DESAT_OURS(int16_t, DESAT_SAME)
    case 4: DESAT_OURS(int32_t, DESAT_SAME)
    case 5: DESAT_OURS(int64_t, DESAT_SAME)
    case 6: DESAT_OURS(uint8_t, DESAT_SAME)
    case 7: DESAT_OURS(uint16_t, DESAT_SAME)
    case 8: DESAT_OURS(uint32_t, DESAT_SAME)
    case 9: DESAT_OURS(uint64_t, DESAT_SAME)
    case 10: DESAT_OURS(bool, DESAT_ANY)
    }
    return 4; /* fmi_versions.py has no other */
}

static double desat_at(const double *values, int64_t place) { return place < 0 ? 0.0 : values[place]; }

/* value i in our own FMU, and in the loop */
#define DESAT_THERE(TYPE) ((TYPE **)o->p[0])[i]
#define DESAT_HERE(TYPE) ((TYPE *)o->p[1])[i]
#define DESAT_MOVE(ONE)                                                                             \
    for (i = 0; i < o->n; i++) ONE;                                                                 \
    return 0;

/* Return the status of a call; end the process if a component forked it. */
static unsigned desat_back(const struct desat_loop *loop, unsigned status)
{
#ifndef _WIN32
    if (loop->process && getpid() != loop->process)
        _exit(0);
#endif
    return status;
}

static unsigned desat_perform(struct desat_loop *loop, const struct desat_operation *o)
{
    double *target = o->p[0];
    const int64_t *first = o->p[1], *second = o->p[2], *index = o->p[3];
    int64_t i;
    switch (o->code) {
    case DESAT_TICK:
        *loop->time = *target = loop->start + ((double)loop->k + o->x[0]) * loop->step;
        return 0;
    case DESAT_LENGTH:
        *target = o->x[0];
        return 0;
    case DESAT_TAKE_8:
        for (i = 0; i < o->n; i++)
            target[first[i]] = ((const double *)o->p[2])[index[i]];
        return 0;
    case DESAT_TAKE_4:
        for (i = 0; i < o->n; i++)
            ((int32_t *)o->p[0])[first[i]] = ((const int32_t *)o->p[2])[index[i]];
        return 0;
    case DESAT_CONVERT: {
        const double *source = o->p[2], *factor = o->p[4], *offset = o->p[5];
        for (i = 0; i < o->n; i++)
            target[first[i]] = source[index[i]] * factor[i] + offset[i];
        return 0;
    }
    case DESAT_WIDEN: {
        const int32_t *source = o->p[2];
        const double *factor = o->p[4], *offset = o->p[5];
        for (i = 0; i < o->n; i++)
            target[first[i]] = source[index[i]] * factor[i] + offset[i];
        return 0;
    }
    case DESAT_PUT_R: DESAT_MOVE(*DESAT_THERE(double) = DESAT_HERE(double))
    case DESAT_PUT_I: DESAT_MOVE(*DESAT_THERE(int64_t) = DESAT_HERE(int32_t))
    case DESAT_PUT_B: DESAT_MOVE(*DESAT_THERE(bool) = DESAT_HERE(int32_t) != 0)
    case DESAT_FETCH_R: DESAT_MOVE(DESAT_HERE(double) = *DESAT_THERE(double))
    case DESAT_FETCH_I: DESAT_MOVE(DESAT_HERE(int32_t) = (int32_t)*DESAT_THERE(int64_t))
    case DESAT_FETCH_B: DESAT_MOVE(DESAT_HERE(int32_t) = *DESAT_THERE(bool))
    case DESAT_TRANSFER:
        *loop->word = o->word;
        return desat_back(loop,
                          ((desat_transfer *)o->p[0])(o->p[1], o->p[2], (size_t)o->n, o->p[3]));
    case DESAT_STEP:
        *loop->word = o->word;
        return desat_back(loop, ((desat_do_step *)o->p[0])(o->p[1], *(double *)o->p[2],
                                                           *(double *)o->p[3], 1));
    case DESAT_TRANSFER_3:
        *loop->word = o->word;
        return desat_back(loop, ((desat_transfer_3 *)o->p[0])(o->p[1], o->p[2], (size_t)o->n, o->p[3],
                                                  (size_t)(uintptr_t)o->p[4]));
    case DESAT_STEP_3: {
        struct desat_done *done = o->p[4];
        *loop->word = o->word;
        const double t = *(double *)o->p[2], dt = *(double *)o->p[3], end = t + dt;
        done->event = done->terminate = done->early = false;
        done->last = end;
        const unsigned status = desat_back(
            loop, ((desat_do_step_3 *)o->p[0])(o->p[1], t, dt, true, &done->event, &done->terminate,
                                         &done->early, &done->last));
        done->whole = status > 1 || fabs(done->last - end) <= DESAT_NEAR * dt;
        return status <= 1 && (done->terminate || done->early || done->event || !done->whole)
                   ? 3 : status;
    }
    case DESAT_TO_TYPE:
        return desat_typed(o, false);
    case DESAT_FROM_TYPE:
        return desat_typed(o, true);
    case DESAT_COPY:
        memcpy(o->p[0], o->p[1], (size_t)o->n);
        return 0;
    case DESAT_CLEAR:
        for (i = 0; i < o->n; i++)
            target[i] = 0.0;
        return 0;
    case DESAT_JOIN: {
        double *mean = o->p[3], *slope = o->p[4];
        for (i = 0; i < o->n; i++) {
            double m = desat_at(target, first[i]), s = desat_at(target, second[i]);
            mean[i] += o->x[0] * m;
            slope[i] += o->x[1] * m + o->x[2] * s;
        }
        return 0;
    }
    case DESAT_CUT: {
        const int64_t *slopes = o->p[4];
        for (i = 0; i < o->n; i++) {
            double m = desat_at(target, first[i]), s = desat_at(target, second[i]);
            target[index[i]] = m + o->x[0] * s;
            if (slopes[i] >= 0)
                target[slopes[i]] = o->x[1] * s;
        }
        return 0;
    }
    case DESAT_KEEP: {
        double *row = target + *(int64_t *)o->p[1] * o->n;
        for (i = 0; i < o->n; i++)
            row[i] = ((const double *)o->p[2])[index[i]];
        ++*(int64_t *)o->p[1];
        return 0;
    }
    }
    return 4; /* compiled.py makes no other */
}

static int desat_all_of(struct desat_loop *loop, int64_t from, int64_t to)
{
    unsigned worst = 0;
    for (int64_t i = from; i < to; i++) {
        const struct desat_operation *o = loop->operations + i;
        unsigned status = desat_perform(loop, o);
        worst = status > worst ? status : worst;
        if (!o->more) {
            if (worst > 1) {
                loop->failed = i;
                loop->status = worst;
                return 1;
            }
            if (worst == 1 && !loop->warned[i]) {
                loop->warned[i] = loop->k + 1;
                loop->warnings++;
            }
            worst = 0;
        }
    }
    return 0;
}

static void desat_take_row(struct desat_loop *loop)
{
    int64_t k = loop->k + loop->ahead, row = *loop->taken;
    loop->times[row] = loop->start + (double)k * loop->step;
    for (int64_t i = 0; i < loop->tables; i++) {
        const struct desat_table *t = loop->table + i;
        memcpy(t->rows + row * t->bytes, t->source, (size_t)t->bytes);
    }
    *loop->taken = row + 1;
}

/* zero times a value that is not finite is NaN, and so is any sum with it */
static int desat_is_finite(const struct desat_loop *loop)
{
    const double *x = loop->real;
    double sum[4] = {0.0};
    int64_t i = 0;
    for (; i + 4 <= loop->reals; i += 4)
        for (int j = 0; j < 4; j++)
            sum[j] += 0.0 * x[i + j];
    for (; i < loop->reals; i++)
        sum[0] += 0.0 * x[i];
    return sum[0] + sum[1] + sum[2] + sum[3] == 0.0;
}

static int desat_is_met(const struct desat_loop *loop)
{
    double largest = 0.0;
    if (loop->how == DESAT_NEVER || loop->how == DESAT_ALWAYS)
        return loop->how == DESAT_ALWAYS;
    for (int64_t i = 0; i < loop->watched; i++) {
        int64_t place = loop->places[i];
        double value = loop->watched_reals ? loop->watched_reals[place]
                                           : (double)loop->watched_integers[place];
        if (loop->how == DESAT_REACHES && value != loop->limit)
            return 0;
        largest = fmax(largest, fabs(value));
    }
    return loop->how == DESAT_REACHES || (loop->how == DESAT_BELOW ? largest < loop->limit
                                                       : largest > loop->limit);
}

/* Make `steps` steps, or fewer if the caller has to act: rows to write, or a condition that is met, or
 * was met one step before. */
int desat_loop(struct desat_loop *loop, int64_t steps)
{
    for (int64_t until = loop->k + steps; loop->k < until;) {
        const int64_t *edges = loop->edges + 2 * (loop->k % loop->steps);
        if (desat_all_of(loop, edges[0], edges[1]))
            return DESAT_FAILED;
        if (loop->taken)
            desat_take_row(loop);
        if (desat_all_of(loop, edges[1], edges[2]))
            return DESAT_FAILED;
        *loop->word = 0;
        loop->k++;
        if (!desat_is_finite(loop)) {
            loop->asked = 1;
            return DESAT_NOT_FINITE;
        }
        int64_t met = desat_is_met(loop), ask = met || loop->asked;
        loop->asked = met;
        if (ask || (loop->taken && *loop->taken == loop->capacity))
            return DESAT_LOOK;
    }
    return DESAT_LOOK;
}
