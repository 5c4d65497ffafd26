/* A stranger's FMU of FMI 1.0: x' = k u, m = n + 1, c = not b. References: k, u, x; n, m; b, c. */
#include <stdarg.h>
#include <stddef.h>

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished;
} functions;
static struct { double r[3]; int i[2]; char b[2]; functions host; int begun; } all[8], *c_;
static int made;
#define F(name) gain1_fmi##name

const char *F(GetTypesPlatform)(void) { return "standard32"; }
const char *F(GetVersion)(void) { return "1.0"; }
void *F(InstantiateSlave)(const char *called, const char *guid, const char *where, const char *mime, double wait,
                          char visible, char interactive, functions host, char logging)
{
    (void)called, (void)guid, (void)where, (void)mime, (void)wait, (void)visible, (void)interactive, (void)logging;
    c_ = &all[made++ % 8];
    c_->host = host, c_->r[0] = 1.0, c_->r[1] = c_->r[2] = 0.0, c_->i[0] = c_->b[0] = c_->begun = 0;
    return c_;
}
#define C(p) (c_ = (p))
int F(InitializeSlave)(void *c, double t, char stops, double stop)
{
    (void)t, (void)stops, (void)stop;
    if (C(c)->r[0] < 0.0) {
        c_->host.logger(c, "gain", 3, "error", "k = %g: 0 or more is needed", c_->r[0]);
        return 3;
    }
    return c_->begun++ ? 3 : 0;
}
int F(TerminateSlave)(void *c) { return C(c)->r[0] == 13.0 ? 3 : C(c)->r[0] == 12.0; }
int F(ResetSlave)(void *c) { (void)c; return 0; }
void F(FreeSlaveInstance)(void *c) { (void)c; }
int F(SetDebugLogging)(void *c, char on) { (void)c, (void)on; return 0; }
#define MOVE(kind, type, of) \
    int F(Get##kind)(void *c, const unsigned *v, size_t n, type *x) { for (size_t k = 0; k < n; k++) x[k] = C(c)->of[v[k]]; return C(c)->r[0] == 11.0 && c_->begun; } \
    int F(Set##kind)(void *c, const unsigned *v, size_t n, const type *x) { for (size_t k = 0; k < n; k++) C(c)->of[v[k]] = x[k]; return 0; }
MOVE(Real, double, r) MOVE(Integer, int, i) MOVE(Boolean, char, b)
int F(DoStep)(void *c, double t, double dt, char fresh)
{
    (void)t;
    if (!C(c)->begun || fresh != 1) return 3;
    c_->r[2] += dt * c_->r[0] * c_->r[1];
    c_->i[1] = c_->i[0] + 1, c_->b[1] = !c_->b[0];
    return 0;
}
#define NOT_HERE(f) int F(f)(void *c) { (void)c; return 3; }
NOT_HERE(GetString) NOT_HERE(SetString) NOT_HERE(SetRealInputDerivatives) NOT_HERE(GetRealOutputDerivatives)
NOT_HERE(CancelStep) NOT_HERE(GetStatus) NOT_HERE(GetRealStatus) NOT_HERE(GetIntegerStatus)
NOT_HERE(GetBooleanStatus) NOT_HERE(GetStringStatus)
