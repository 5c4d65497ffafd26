/* A stranger's FMU of all types, FMI 2.0: variable 16 + n is a copy of variable n < 8; the
   Real 24 + n is twice the Real n and one more, with feedthrough, and the Real 12 is that of
   the Real 0 as of the last step. */
#include <stdlib.h>
#include <string.h>

typedef void log_message(void *, const char *, int, const char *, const char *, ...);
typedef struct {
    log_message *log;
    void *allocate, *release, *finished, *environment;
} services;

typedef struct {
    const services *of;
    double real[32];
    int integer[32], boolean[32];
    char text[32][64];
} component;

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
component *fmi2Instantiate(const char *called, int kind, const char *guid, const char *where,
                           const services *of, int visible, int logging)
{
    (void)called, (void)kind, (void)guid, (void)where, (void)visible, (void)logging;
    component *c = calloc(1, sizeof *c);
    c->of = of;
    c->real[1] = 10.0, c->real[2] = 20.0, c->real[3] = 30.0;
    strcpy(c->text[0], "as it was");
    return c;
}
void fmi2FreeInstance(component *c) { free(c); }
int fmi2SetDebugLogging(component *c, int on, size_t n, const void *of) { (void)c, (void)on, (void)n, (void)of; return 0; }
int fmi2SetupExperiment(component *c, int a, double b, double t, int d, double e)
{
    (void)c, (void)a, (void)b, (void)t, (void)d, (void)e;
    return 0;
}
#define NOTHING(f) int f(component *c) { (void)c; return 0; }
NOTHING(fmi2EnterInitializationMode) NOTHING(fmi2ExitInitializationMode) NOTHING(fmi2Terminate)
NOTHING(fmi2Reset)
static unsigned source(unsigned r) { return r >= 16 && r < 24 ? r - 16 : r; }
#define SCALARS(name, type, of)                                                          \
    int fmi2Set##name(component *c, const unsigned *r, size_t n, const type *v)          \
    {                                                                                    \
        for (size_t i = 0; i < n; i++) c->of[r[i]] = v[i];                               \
        return 0;                                                                        \
    }                                                                                    \
    int fmi2Get##name(component *c, const unsigned *r, size_t n, type *v)                \
    {                                                                                    \
        for (size_t i = 0; i < n; i++)                                                   \
            v[i] = r[i] >= 24 ? 2 * c->of[r[i] - 24] + 1 : c->of[source(r[i])];          \
        return 0;                                                                        \
    }
SCALARS(Real, double, real)
SCALARS(Integer, int, integer)
SCALARS(Boolean, int, boolean)
int fmi2SetString(component *c, const unsigned *r, size_t n, const char *const *v)
{
    for (size_t i = 0; i < n; i++) strncpy(c->text[r[i]], v[i], 63);
    return 0;
}
int fmi2GetString(component *c, const unsigned *r, size_t n, const char **v)
{
    for (size_t i = 0; i < n; i++) v[i] = c->text[source(r[i])];
    return 0;
}
int fmi2DoStep(component *c, double t, double dt, int no)
{
    (void)t, (void)dt, (void)no;
    /* the Integer 15 counts the letters of the text 0 */
    c->integer[15] = (int)strlen(c->text[0]);
    c->real[12] = 2 * c->real[0] + 1;
    /* the Boolean 14 lets it complain at each step */
    if (c->boolean[14]) c->of->log(c->of->environment, "typed", 1, "warning", "not again");
    return 0;
}
#define NOT_HERE(f) int f(component *c) { (void)c; return 3; }
NOT_HERE(fmi2CancelStep) NOT_HERE(fmi2GetFMUstate) NOT_HERE(fmi2SetFMUstate)
NOT_HERE(fmi2FreeFMUstate) NOT_HERE(fmi2SerializedFMUstateSize) NOT_HERE(fmi2SerializeFMUstate)
NOT_HERE(fmi2DeSerializeFMUstate) NOT_HERE(fmi2GetDirectionalDerivative)
NOT_HERE(fmi2SetRealInputDerivatives) NOT_HERE(fmi2GetRealOutputDerivatives)
NOT_HERE(fmi2GetStatus) NOT_HERE(fmi2GetRealStatus) NOT_HERE(fmi2GetIntegerStatus)
NOT_HERE(fmi2GetBooleanStatus) NOT_HERE(fmi2GetStringStatus)
