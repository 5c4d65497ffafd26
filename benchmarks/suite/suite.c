/* The one FMU of the suite, FMI 2.0 and 3.0.

   Of each type the variables n < 16 can be set and 16 + n is a copy of n. Of the Reals 32 + n is
   2 n + 1 at once, 48 + n is the variable 8 + n plus the sum of n over the steps (15 starts with 1, so
   55 does, too), 64 and 66 are the time, and 65 is the length of the text 1. The array 71 is twice the
   array 70, both with as many elements as 72 says. A variable n < 8 starts with n (true where n is odd,
   a text of n letters), but the integers 7 of FMI 3.0 with a large number. The token is
   "{suite-FAULT-...}": how it fails in its fourth step. */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#ifdef _WIN32
void __stdcall Sleep(unsigned long);
#define WAIT Sleep(1000)
#else
#include <unistd.h>
#define WAIT sleep(1)
#endif

enum { NOTHING, DISCARD, ERROR, FATAL, NOT_A_NUMBER, CRASH, EXIT, ENDLESS, BEYOND, LOGS };
#define INTEGERS(X)                                                                                  \
    X(Int8, int8_t, -100) X(UInt8, uint8_t, 200) X(Int16, int16_t, -30000) X(UInt16, uint16_t, 60000) \
    X(Int32, int32_t, -2000000000) X(UInt32, uint32_t, 4000000000) X(Int64, int64_t, -4000000000)     \
    X(UInt64, uint64_t, 4000000000)
#define MEMBER(NAME, TYPE, LARGE) TYPE NAME[16];
typedef void logger2(void *, const char *, int, const char *, const char *, ...);
typedef void logger3(void *, int, const char *, const char *);
typedef struct {
    double Float64[16], sum[8], t, u[16];
    float Float32[16];
    INTEGERS(MEMBER)
    bool Boolean[16];
    char text[16][64];
    uint64_t size;
    int how;
    void *environment;
    logger2 *logger2;
    logger3 *logger3;
} model;
struct callbacks { logger2 *log; void *allocate, *release, *finished, *environment; };

static model *instantiate(const char *token, void *environment)
{
    if (strncmp(token, "{suite-", 7)) return NULL;
    model *m = calloc(1, sizeof *m);
    for (int i = 0; i < 8; i++) {
        m->Float64[i] = m->Float32[i] = i;
#define START(NAME, TYPE, LARGE) m->NAME[i] = i;
        INTEGERS(START)
        m->Boolean[i] = i & 1;
        memset(m->text[i], 'a', i);
    }
#define LARGEST(NAME, TYPE, LARGE) m->NAME[7] = LARGE;
    INTEGERS(LARGEST)
    for (int i = 0; i < 16; i++) m->u[i] = i + 1;
    m->Float64[15] = 1.0;
    m->size = 3;
    m->how = atoi(token + 7);
    m->environment = environment;
    return m;
}

static double number(const model *m, unsigned r)
{
    if (r == 66) return m->t;
    if (r == 64) return m->how == NOT_A_NUMBER && m->t > 3.5 ? NAN : m->t;
    if (r == 65) return strlen(m->text[1]);
    if (r >= 48) return m->Float64[8 + r % 8] + m->sum[r % 8];
    return r >= 32 ? 2.0 * m->Float64[r % 16] + 1.0 : m->Float64[r % 16];
}

static int step(model *m, double t, double dt)
{
    if (t > 2.5) switch (m->how) {
    case DISCARD: return 2;
    case ERROR: return 3;
    case FATAL: return 4;
    case CRASH: *(volatile int *)8 = 1; break;
    case EXIT: exit(0);
    case ENDLESS: for (;;) WAIT;
    case LOGS:
        for (int i = 0; i < 1000; i++) {
            if (m->logger2) m->logger2(m->environment, "a", 1, "warning", "one of many: %d", i);
            if (m->logger3) m->logger3(m->environment, 1, "warning", "one of many");
        }
    }
    for (int i = 0; i < 8; i++) m->sum[i] += m->Float64[i] * dt;
    m->t = t + dt;
    return 0;
}

/* --- FMI 2.0 --- */

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
model *fmi2Instantiate(const char *name, int kind, const char *guid, const char *where,
                       const struct callbacks *given, int visible, int logging)
{
    (void)name, (void)kind, (void)where, (void)visible, (void)logging;
    model *m = instantiate(guid, given->environment);
    if (m) m->logger2 = given->log;
    return m;
}
void fmi2FreeInstance(model *m) { free(m); }
int fmi2DoStep(model *m, double t, double dt, int no) { (void)no; return step(m, t, dt); }
#define ACCESS2(NAME, TYPE, SET, GET)                                                                \
    int fmi2Set##NAME(model *m, const unsigned *r, size_t n, TYPE const *v)                          \
    {                                                                                                \
        for (size_t i = 0; i < n; i++) SET;                                                          \
        return 0;                                                                                    \
    }                                                                                                \
    int fmi2Get##NAME(model *m, const unsigned *r, size_t n, TYPE *v)                                \
    {                                                                                                \
        for (size_t i = 0; i < n; i++) v[i] = GET;                                                   \
        return 0;                                                                                    \
    }
ACCESS2(Real, double, m->Float64[r[i] % 16] = v[i], number(m, r[i]))
ACCESS2(Integer, int, m->Int32[r[i] % 16] = v[i], m->Int32[r[i] % 16])
ACCESS2(Boolean, int, m->Boolean[r[i] % 16] = v[i], m->Boolean[r[i] % 16])
ACCESS2(String, const char *, strncpy(m->text[r[i] % 16], v[i], 63), m->text[r[i] % 16])

/* --- FMI 3.0 --- */

const char *fmi3GetVersion(void) { return "3.0"; }
model *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *where, bool visible,
                                   bool logging, bool event, bool early, const unsigned *r, size_t n,
                                   void *environment, logger3 *log, void *update)
{
    (void)name, (void)where, (void)visible, (void)logging, (void)event, (void)early, (void)r, (void)n;
    (void)update;
    model *m = instantiate(token, environment);
    if (m) m->logger3 = log;
    return m;
}
void fmi3FreeInstance(model *m) { free(m); }
int fmi3DoStep(model *m, double t, double dt, bool no, bool *event, bool *terminate, bool *early,
               double *last)
{
    (void)no;
    *event = *terminate = *early = false;
    *last = t + dt * (m->how == BEYOND && t > 2.5 ? 2.0 : 1.0);
    return step(m, t, dt);
}
#define ACCESS3(NAME, TYPE, LARGE)                                                                   \
    int fmi3Set##NAME(model *m, const unsigned *r, size_t n, const TYPE *v, size_t total)            \
    {                                                                                                \
        for (size_t i = 0; i < n && i < total; i++) m->NAME[r[i] % 16] = v[i];                       \
        return 0;                                                                                    \
    }                                                                                                \
    int fmi3Get##NAME(model *m, const unsigned *r, size_t n, TYPE *v, size_t total)                  \
    {                                                                                                \
        for (size_t i = 0; i < n && i < total; i++) v[i] = m->NAME[r[i] % 16];                       \
        return 0;                                                                                    \
    }
#define SMALL(X)                                                                                     \
    X(Int8, int8_t, 0) X(UInt8, uint8_t, 0) X(Int16, int16_t, 0) X(UInt16, uint16_t, 0)              \
    X(Int32, int32_t, 0) X(UInt32, uint32_t, 0) X(Int64, int64_t, 0) X(Float32, float, 0)            \
    X(Boolean, bool, 0)
SMALL(ACCESS3)
int fmi3SetUInt64(model *m, const unsigned *r, size_t n, const uint64_t *v, size_t total)
{
    (void)total;
    for (size_t i = 0; i < n; i++) *(r[i] == 72 ? &m->size : &m->UInt64[r[i] % 16]) = v[i];
    return m->size > 16 ? 3 : 0;
}
int fmi3GetUInt64(model *m, const unsigned *r, size_t n, uint64_t *v, size_t total)
{
    (void)total;
    for (size_t i = 0; i < n; i++) v[i] = r[i] == 72 ? m->size : m->UInt64[r[i] % 16];
    return 0;
}
int fmi3SetFloat64(model *m, const unsigned *r, size_t n, const double *v, size_t total)
{
    const double *end = v + total;
    for (size_t i = 0; i < n; i++) {
        if (v + (r[i] == 70 ? m->size : 1) > end) return 3;
        if (r[i] == 70) for (size_t k = 0; k < m->size; k++) m->u[k] = *v++;
        else m->Float64[r[i] % 16] = *v++;
    }
    return v == end ? 0 : 3;
}
int fmi3GetFloat64(model *m, const unsigned *r, size_t n, double *v, size_t total)
{
    const double *end = v + total;
    for (size_t i = 0; i < n; i++) {
        const bool array = r[i] == 70 || r[i] == 71;
        if (v + (array ? m->size : 1) > end) return 3;
        if (array) for (size_t k = 0; k < m->size; k++) *v++ = m->u[k] * (r[i] - 69);
        else *v++ = number(m, r[i]);
    }
    return v == end ? 0 : 3;
}
int fmi3SetString(model *m, const unsigned *r, size_t n, const char *const *v, size_t total)
{
    (void)total;
    for (size_t i = 0; i < n; i++) strncpy(m->text[r[i] % 16], v[i], 63);
    return 0;
}
int fmi3GetString(model *m, const unsigned *r, size_t n, const char **v, size_t total)
{
    (void)total;
    for (size_t i = 0; i < n; i++) v[i] = m->text[r[i] % 16];
    return 0;
}
int fmi3SetBinary(model *m, const unsigned *r, size_t n, const size_t *sizes, const uint8_t *const *v,
                  size_t total)
{
    (void)total;
    for (size_t i = 0; i < n; i++) {
        memset(m->text[r[i] % 16], 0, 64);
        memcpy(m->text[r[i] % 16], v[i], sizes[i] < 64 ? sizes[i] : 63);
    }
    return 0;
}
int fmi3GetBinary(model *m, const unsigned *r, size_t n, size_t *sizes, const uint8_t **v, size_t total)
{
    (void)total;
    for (size_t i = 0; i < n; i++) {
        v[i] = (const uint8_t *)m->text[r[i] % 16];
        sizes[i] = strlen(m->text[r[i] % 16]);
    }
    return 0;
}
#define DONE(NAME) int NAME(model *m) { (void)m; return 0; }
DONE(fmi2SetupExperiment) DONE(fmi2EnterInitializationMode) DONE(fmi2ExitInitializationMode)
DONE(fmi2Terminate) DONE(fmi2Reset) DONE(fmi2SetDebugLogging) DONE(fmi3EnterInitializationMode)
DONE(fmi3ExitInitializationMode) DONE(fmi3Terminate) DONE(fmi3Reset) DONE(fmi3SetDebugLogging)
DONE(fmi3EnterConfigurationMode) DONE(fmi3ExitConfigurationMode)
#define NONE(NAME) int NAME(void) { return 3; }
NONE(fmi2CancelStep) NONE(fmi2CompletedIntegratorStep) NONE(fmi2DeSerializeFMUstate)
NONE(fmi2EnterContinuousTimeMode) NONE(fmi2EnterEventMode) NONE(fmi2FreeFMUstate)
NONE(fmi2GetBooleanStatus) NONE(fmi2GetContinuousStates) NONE(fmi2GetDerivatives)
NONE(fmi2GetDirectionalDerivative) NONE(fmi2GetEventIndicators) NONE(fmi2GetFMUstate)
NONE(fmi2GetIntegerStatus) NONE(fmi2GetNominalsOfContinuousStates)
NONE(fmi2GetRealOutputDerivatives) NONE(fmi2GetRealStatus) NONE(fmi2GetStatus)
NONE(fmi2GetStringStatus) NONE(fmi2NewDiscreteStates) NONE(fmi2SerializeFMUstate)
NONE(fmi2SerializedFMUstateSize) NONE(fmi2SetContinuousStates) NONE(fmi2SetFMUstate)
NONE(fmi2SetRealInputDerivatives) NONE(fmi2SetTime) NONE(fmi3ActivateModelPartition)
NONE(fmi3CompletedIntegratorStep) NONE(fmi3DeserializeFMUState) NONE(fmi3EnterContinuousTimeMode)
NONE(fmi3EnterEventMode) NONE(fmi3EnterStepMode) NONE(fmi3EvaluateDiscreteStates)
NONE(fmi3FreeFMUState) NONE(fmi3GetAdjointDerivative) NONE(fmi3GetClock)
NONE(fmi3GetContinuousStateDerivatives) NONE(fmi3GetContinuousStates)
NONE(fmi3GetDirectionalDerivative) NONE(fmi3GetEventIndicators) NONE(fmi3GetFMUState)
NONE(fmi3GetIntervalDecimal) NONE(fmi3GetIntervalFraction) NONE(fmi3GetNominalsOfContinuousStates)
NONE(fmi3GetNumberOfContinuousStates) NONE(fmi3GetNumberOfEventIndicators)
NONE(fmi3GetNumberOfVariableDependencies) NONE(fmi3GetOutputDerivatives) NONE(fmi3GetShiftDecimal)
NONE(fmi3GetShiftFraction) NONE(fmi3GetVariableDependencies) NONE(fmi3InstantiateModelExchange)
NONE(fmi3InstantiateScheduledExecution) NONE(fmi3SerializeFMUState) NONE(fmi3SerializedFMUStateSize)
NONE(fmi3SetClock) NONE(fmi3SetContinuousStates) NONE(fmi3SetFMUState) NONE(fmi3SetIntervalDecimal)
NONE(fmi3SetIntervalFraction) NONE(fmi3SetShiftDecimal) NONE(fmi3SetShiftFraction) NONE(fmi3SetTime)
NONE(fmi3UpdateDiscreteStates)
