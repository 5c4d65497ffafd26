/* A stranger's y = k u, FMI 2.0; its values in the order k, u, y. */
#include <string.h>

typedef double *component;
static double all[16][3];
static int made;

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
component fmi2Instantiate(const char *called, int kind, const char *guid, const char *where,
                          const void *callbacks, int visible, int logging)
{
    (void)called, (void)kind, (void)guid, (void)where, (void)callbacks, (void)visible, (void)logging;
    component v = all[made++ % 16];
    memset(v, 0, sizeof all[0]);
    v[0] = 1.0;
    return v;
}
void fmi2FreeInstance(component c) { (void)c; }
int fmi2SetDebugLogging(component c, int on, size_t n, const void *of) { (void)c, (void)on, (void)n, (void)of; return 0; }
int fmi2SetupExperiment(component c, int a, double b, double t, int d, double e)
{
    (void)c, (void)a, (void)b, (void)t, (void)d, (void)e;
    return 0;
}
#define NOTHING(f) int f(component c) { (void)c; return 0; }
NOTHING(fmi2EnterInitializationMode) NOTHING(fmi2ExitInitializationMode) NOTHING(fmi2Terminate)
NOTHING(fmi2Reset)
int fmi2SetReal(component c, const unsigned *r, size_t n, const double *v)
{
    for (size_t i = 0; i < n; i++) c[r[i]] = v[i];
    return 0;
}
int fmi2GetReal(component c, const unsigned *r, size_t n, double *v)
{
    for (size_t i = 0; i < n; i++) v[i] = r[i] == 2 ? c[0] * c[1] : c[r[i]];
    return 0;
}
int fmi2DoStep(component c, double t, double dt, int no) { (void)c, (void)t, (void)dt, (void)no; return 0; }
#define NOT_HERE(f) int f(component c) { (void)c; return 3; }
NOT_HERE(fmi2CancelStep) NOT_HERE(fmi2GetFMUstate) NOT_HERE(fmi2SetFMUstate)
NOT_HERE(fmi2FreeFMUstate) NOT_HERE(fmi2SerializedFMUstateSize) NOT_HERE(fmi2SerializeFMUstate)
NOT_HERE(fmi2DeSerializeFMUstate) NOT_HERE(fmi2GetDirectionalDerivative)
NOT_HERE(fmi2GetInteger) NOT_HERE(fmi2GetBoolean) NOT_HERE(fmi2GetString) NOT_HERE(fmi2SetInteger)
NOT_HERE(fmi2SetBoolean) NOT_HERE(fmi2SetString) NOT_HERE(fmi2SetRealInputDerivatives)
NOT_HERE(fmi2GetRealOutputDerivatives) NOT_HERE(fmi2GetStatus) NOT_HERE(fmi2GetRealStatus)
NOT_HERE(fmi2GetIntegerStatus) NOT_HERE(fmi2GetBooleanStatus) NOT_HERE(fmi2GetStringStatus)
