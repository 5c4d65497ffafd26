/* A stranger of FMI 3.0: y = 2 u, arrays whose length is the structural parameter n (3). */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>

typedef struct { uint64_t n; bool configuring; double u[16]; } instance;

const char *fmi3GetVersion(void) { return "3.0"; }
void *fmi3InstantiateCoSimulation(void)
{
    instance *c = calloc(1, sizeof *c);
    c->n = 3;
    for (int i = 0; i < 16; i++) c->u[i] = i + 1.0;
    return c;
}
void fmi3FreeInstance(instance *c) { free(c); }
int fmi3EnterConfigurationMode(instance *c) { c->configuring = true; return 0; }
int fmi3ExitConfigurationMode(instance *c) { c->configuring = false; return 0; }
int fmi3EnterInitializationMode(instance *c) { (void)c; return 0; }
int fmi3ExitInitializationMode(instance *c) { (void)c; return 0; }
int fmi3Terminate(instance *c) { (void)c; return 0; }
int fmi3DoStep(instance *c, double t, double dt, bool no, bool *event, bool *terminate, bool *early,
               double *last)
{
    (void)c, (void)no;
    *event = *terminate = *early = false;
    *last = t + dt;
    return 0;
}
int fmi3SetUInt64(instance *c, const unsigned *vr, size_t n, const uint64_t *v, size_t total)
{
    (void)vr;
    if (!c->configuring || n != 1 || total != 1 || *v > 16) return 3;
    c->n = *v;
    return 0;
}
int fmi3SetFloat64(instance *c, const unsigned *vr, size_t n, const double *v, size_t total)
{
    (void)vr;
    if (n != 1 || total != c->n) return 3;
    for (size_t i = 0; i < total; i++) c->u[i] = v[i];
    return 0;
}
int fmi3GetFloat64(instance *c, const unsigned *vr, size_t n, double *v, size_t total)
{
    (void)vr;
    if (n != 1 || total != c->n) return 3;
    for (size_t i = 0; i < total; i++) v[i] = 2.0 * c->u[i];
    return 0;
}
