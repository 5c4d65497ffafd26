/* A stranger's momentum manager: cross-product dumping, wheels along the body's axes or in a
   pyramid by its own parameter. The role's names, nothing else of ours. */
#include <math.h>
#include <string.h>

typedef void *component;
enum { GAIN, LIMIT, AXES, B = AXES + 12, H = B + 3, TAU = H + 4, WHEEL = TAU + 3, M = WHEEL + 4,
       VALUES = M + 3 };
static double all[8][VALUES];
static int made;

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
component fmi2Instantiate(const char *called, int kind, const char *guid, const char *where,
                          const void *callbacks, int visible, int logging)
{
    (void)called, (void)kind, (void)guid, (void)where, (void)callbacks, (void)visible, (void)logging;
    double *v = all[made++ % 8];
    memset(v, 0, sizeof all[0]);
    v[GAIN] = 1e-3, v[LIMIT] = 5.0;
    v[AXES] = v[AXES + 5] = v[AXES + 10] = 1.0;
    return v;
}
void fmi2FreeInstance(component c) { (void)c; }
int fmi2SetDebugLogging(component c, int on, size_t n, const void *of) { (void)c, (void)on, (void)n, (void)of; return 0; }
int fmi2SetupExperiment(component c, int a, double b, double t, int d, double e)
{
    (void)c, (void)a, (void)b, (void)t, (void)d, (void)e;
    return 0;
}
int fmi2EnterInitializationMode(component c) { (void)c; return 0; }
int fmi2ExitInitializationMode(component c) { (void)c; return 0; }
int fmi2Terminate(component c) { (void)c; return 0; }
int fmi2Reset(component c) { (void)c; return 0; }
int fmi2SetReal(component c, const unsigned *r, size_t n, const double *v)
{
    for (size_t i = 0; i < n; i++) ((double *)c)[r[i]] = v[i];
    return 0;
}
int fmi2GetReal(component c, const unsigned *r, size_t n, double *v)
{
    for (size_t i = 0; i < n; i++) v[i] = ((double *)c)[r[i]];
    return 0;
}
#define NOT_HERE(f) int f(component c) { (void)c; return 3; }
NOT_HERE(fmi2CancelStep) NOT_HERE(fmi2GetFMUstate) NOT_HERE(fmi2SetFMUstate)
NOT_HERE(fmi2FreeFMUstate) NOT_HERE(fmi2SerializedFMUstateSize) NOT_HERE(fmi2SerializeFMUstate)
NOT_HERE(fmi2DeSerializeFMUstate) NOT_HERE(fmi2GetDirectionalDerivative)
NOT_HERE(fmi2GetInteger) NOT_HERE(fmi2GetBoolean) NOT_HERE(fmi2GetString) NOT_HERE(fmi2SetInteger)
NOT_HERE(fmi2SetBoolean) NOT_HERE(fmi2SetString) NOT_HERE(fmi2SetRealInputDerivatives)
NOT_HERE(fmi2GetRealOutputDerivatives) NOT_HERE(fmi2GetStatus) NOT_HERE(fmi2GetRealStatus)
NOT_HERE(fmi2GetIntegerStatus) NOT_HERE(fmi2GetBooleanStatus) NOT_HERE(fmi2GetStringStatus)

int fmi2DoStep(component c, double t, double dt, int no)
{
    double *v = c, *b = v + B, h[3] = {0}, wanted[3], square = 0.0;
    (void)t, (void)dt, (void)no;
    for (int i = 0; i < 3; i++) {
        square += b[i] * b[i];
        for (int j = 0; j < 4; j++) h[i] += v[AXES + 4 * i + j] * v[H + j];
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double m = square > 0.0 ? v[GAIN] * (h[j] * b[k] - h[k] * b[j]) / square : 0.0;
        v[M + i] = fmax(-v[LIMIT], fmin(v[LIMIT], m));
    }
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        wanted[i] = v[M + j] * b[k] - v[M + k] * b[j] - v[TAU + i];
    }
    /* A A' is diagonal for both arrangements */
    for (int j = 0; j < 4; j++) {
        v[WHEEL + j] = 0.0;
        for (int i = 0; i < 3; i++) {
            double row = 0.0;
            for (int l = 0; l < 4; l++) row += v[AXES + 4 * i + l] * v[AXES + 4 * i + l];
            if (row > 0.0) v[WHEEL + j] += v[AXES + 4 * i + j] * wanted[i] / row;
        }
    }
    return 0;
}
