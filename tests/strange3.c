/* A stranger of FMI 3.0: a type each, in and out, arrays of a length that a structural parameter
   says, and what a master may have to refuse. Value references: a type's number, by two, from 20. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef void log_message(void *, int, const char *, const char *);
typedef struct {
    double t, gain, u[3], y[3], table[4];
    float f_in, f_out;
    int32_t trick;
#define EACH(ONE)                                                                                    \
    ONE(Int8, int8_t, 20) ONE(Int16, int16_t, 22) ONE(Int32, int32_t, 24) ONE(UInt8, uint8_t, 28)    \
    ONE(UInt16, uint16_t, 30) ONE(UInt32, uint32_t, 32) ONE(UInt64, uint64_t, 34)
#define MEMBER(NAME, TYPE, VR) TYPE NAME[2];
    EACH(MEMBER)
    int64_t Int64[2], mode[2];
    bool Boolean[2];
} model;
typedef struct { model m; void *to; log_message *log; } instance;

/* what it does otherwise, by its parameter `trick`, once its time is beyond 3 s */
enum { NOTHING, ENDS, IS_EARLY, DISCARDS, IS_BEYOND, IS_SHORT, WANTS_EVENT, GETTER_WARNS, SETTER_WARNS,
       STEP_WARNS, EXIT_WARNS, ENTER_NEGATIVE, TERMINATE_WARNS, TERMINATE_FAILS, IS_NO_NUMBER,
       LOGS_OK, LOGS_WARNINGS };

#ifndef VERSION
#define VERSION "3.0"
#endif
const char *fmi3GetVersion(void) { return VERSION; }
void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *where, bool visible,
                                  bool logging, bool event, bool early, const unsigned *vr, size_t n,
                                  void *to, log_message *log, void *update)
{
    instance *c = calloc(1, sizeof *c);
    (void)name, (void)where, (void)visible, (void)logging, (void)vr, (void)n, (void)update;
    c->to = to, c->log = log, c->m.gain = 2.0;
#define ONE_(NAME, TYPE, VR) c->m.NAME[0] = 1;
    EACH(ONE_)
    c->m.Int64[0] = c->m.mode[0] = 1;
    if (event || early || strcmp(token, "{three}")) {
        log(to, 3, "error", "neither events nor early returns were wanted");
        return NULL;
    }
    return c;
}
void fmi3FreeInstance(instance *c) { free(c); }
int fmi3EnterInitializationMode(instance *c, bool a, double b, double start, bool d, double e)
{
    (void)a, (void)b, (void)d, (void)e;
    c->m.t = start;
    return c->m.trick == ENTER_NEGATIVE ? -1 : 0;
}

static void follow(model *m)
{
    for (int i = 0; i < 3; i++) m->y[i] = m->gain * m->u[i] + (i == 0 ? sin(m->t) : 0.0);
    for (int i = 0; i < 4; i++) m->table[i] = 10.0 * i + m->t;
    m->f_out = m->f_in / 3.0f;
#define NEXT(NAME, TYPE, VR) m->NAME[1] = (TYPE)(m->NAME[0] + 1);
    EACH(NEXT)
    m->Int64[1] = m->Int64[0] + 1;
    if (m->trick == IS_BEYOND && m->t > 3.0) m->Int64[1] += INT64_C(1) << 40;
    m->mode[1] = m->mode[0];
    m->Boolean[1] = !m->Boolean[0];
}

int fmi3ExitInitializationMode(instance *c) { follow(&c->m); return c->m.trick == EXIT_WARNS; }
int fmi3Terminate(instance *c)
{
    if (c->m.trick == TERMINATE_FAILS) c->log(c->to, 3, "error", "not now");
    return c->m.trick == TERMINATE_FAILS ? 3 : c->m.trick == TERMINATE_WARNS;
}
int fmi3DoStep(instance *c, double t, double dt, bool no, bool *event, bool *terminate, bool *early,
               double *last)
{
    (void)no;
    *event = *terminate = *early = false;
    *last = t;
    if (fabs(t - c->m.t) > 1e-9) return 3;
    if (c->m.trick == DISCARDS && dt > 0.3) {
        c->log(c->to, 2, "error", "100 % too long");
        return 2;
    }
    c->m.t = *last = t + dt;
    const int trick = c->m.t > 3.0 ? c->m.trick : NOTHING;
    *terminate = trick == ENDS;
    *early = trick == IS_EARLY;
    *event = trick == WANTS_EVENT;
    if (trick == IS_SHORT) *last = t + dt / 4.0;
    if (trick == IS_NO_NUMBER) *last = NAN;
    char text[40];
    snprintf(text, sizeof text, "now at %g s", t);
    if (c->m.trick == LOGS_OK) c->log(c->to, 0, "info", text);
    if (c->m.trick == LOGS_WARNINGS) c->log(c->to, 1, "warning", text);
    follow(&c->m);
    return trick == STEP_WARNS;
}

/* n variables, all values of each */
#define VALUES(NAME, TYPE, FIND)                                                                     \
    static TYPE *NAME##_at(model *m, unsigned vr, size_t *size)                                      \
    {                                                                                                \
        *size = 1;                                                                                   \
        FIND                                                                                         \
        return NULL;                                                                                 \
    }                                                                                                \
    int fmi3Get##NAME(instance *c, const unsigned *vr, size_t n, TYPE *v, size_t total)              \
    {                                                                                                \
        for (size_t i = 0, size; i < n; i++, v += size, total -= size) {                             \
            const TYPE *from = NAME##_at(&c->m, vr[i], &size);                                       \
            if (from == NULL || size > total) return 3;                                              \
            memcpy(v, from, size * sizeof *v);                                                       \
        }                                                                                            \
        if (c->m.trick == GETTER_WARNS && c->m.t > 3.0 && !total) return 1;                          \
        return total ? 3 : 0;                                                                        \
    }                                                                                                \
    int fmi3Set##NAME(instance *c, const unsigned *vr, size_t n, const TYPE *v, size_t total)        \
    {                                                                                                \
        for (size_t i = 0, size; i < n; i++, v += size, total -= size) {                             \
            TYPE *to = NAME##_at(&c->m, vr[i], &size);                                               \
            if (to == NULL || size > total) return 3;                                                \
            memcpy(to, v, size * sizeof *v);                                                         \
        }                                                                                            \
        follow(&c->m);                                                                               \
        if (c->m.trick == SETTER_WARNS && c->m.t > 3.0 && !total) return 1;                          \
        return total ? 3 : 0;                                                                        \
    }

VALUES(Float64, double, if (vr == 0) return &m->t; if (vr == 4) return &m->gain; *size = 3;
       if (vr == 2) return m->u; if (vr == 3) return m->y; *size = 4; if (vr == 7) return m->table;)
VALUES(Float32, float, if (vr == 5) return &m->f_in; if (vr == 6) return &m->f_out;)
VALUES(Int64, int64_t, if (vr == 26 || vr == 27) return m->Int64 + vr - 26;
       if (vr == 40 || vr == 41) return m->mode + vr - 40;)
VALUES(Boolean, bool, if (vr == 36 || vr == 37) return m->Boolean + vr - 36;)
#undef EACH
#define EACH(ONE)                                                                                    \
    ONE(Int8, int8_t, 20) ONE(Int16, int16_t, 22) ONE(UInt8, uint8_t, 28) ONE(UInt16, uint16_t, 30)  \
    ONE(UInt32, uint32_t, 32) ONE(UInt64, uint64_t, 34)
#define INTEGER(NAME, TYPE, VR)                                                                      \
    VALUES(NAME, TYPE, if (vr == VR || vr == VR + 1) return m->NAME + vr - VR;)
EACH(INTEGER)
VALUES(Int32, int32_t, if (vr == 24 || vr == 25) return m->Int32 + vr - 24;
       if (vr == 8) return &m->trick;)

int fmi3GetFMUState(instance *c, void **state)
{
    if (*state == NULL) *state = malloc(sizeof c->m);
    memcpy(*state, &c->m, sizeof c->m);
    return 0;
}
int fmi3SetFMUState(instance *c, void *state) { memcpy(&c->m, state, sizeof c->m); return 0; }
int fmi3FreeFMUState(instance *c, void **state) { (void)c; free(*state); *state = NULL; return 0; }
int fmi3SerializedFMUStateSize(instance *c, void *state, size_t *n)
{
    (void)state;
    *n = sizeof c->m;
    return 0;
}
int fmi3SerializeFMUState(instance *c, void *state, uint8_t *bytes, size_t n)
{
    (void)c;
    memcpy(bytes, state, n);
    return 0;
}
int fmi3DeserializeFMUState(instance *c, const uint8_t *bytes, size_t n, void **state)
{
    (void)c;
    *state = malloc(n);
    memcpy(*state, bytes, n);
    return 0;
}
