/* An FMU that does what its parameter `how` says, when its time comes. */
#define _GNU_SOURCE
#include <fenv.h>
#include <locale.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <unistd.h>
#ifdef __SSE__
#include <xmmintrin.h>
#endif

typedef void *component;
typedef void logger(void *, const char *, int, const char *, const char *, ...);
struct callbacks { logger *log; void *allocate, *release, *finished, *environment; };
static struct { int how; double t, y; } me;
static struct callbacks callbacks;
static char name[64];

enum { NOTHING, SEGFAULT, ABORT, KILL, EXIT_0, EXIT_3, HANG, OVERFLOW, IN_FREE, IN_START, IN_EXIT,
       CHDIR, ROUNDING, LOCALE, HANDLER, PRINT, LOG, STEP_ERROR, SLOW, DISCARD, NOT_FINITE,
       NEGATIVE, FORK, LEAVE, TRAPS, UMASK, ROUNDED, SCRIBBLE, KILL_GROUP, DAEMON,
       SCRIBBLE_EARLY, DOT, FATAL, FLUSHED, FORK_BESIDE, STAY,
       SCRIBBLE_LONG, READ_WARNS, STEP_WARNS, ASKS_END, ENDS_BADLY, START_NEGATIVE, SCRIBBLE_CODE };

static int recurse(int n) { volatile char big[65536]; big[n & 65535] = 1; return recurse(n + 1) + big[0]; }

static const char *daemon_name(void)
{
    const char *called = getenv("DAEMON");
    return called ? called : "desat_daemon";
}

static void ruin(int how)
{
    switch (how) {
    case SEGFAULT: *(volatile int *)8 = 1; break;
    case ABORT: abort();
    case KILL: kill(getpid(), SIGKILL); break;
    case EXIT_0: exit(0);
    case EXIT_3: exit(3);
    case HANG: for (;;) pause();
    case OVERFLOW: recurse(0); break;
    }
}

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
component fmi2Instantiate(const char *called, int kind, const char *guid, const char *where,
                          const struct callbacks *given, int visible, int logging)
{
    (void)kind, (void)guid, (void)where, (void)visible, (void)logging;
    callbacks = *given;
    strncpy(name, called, sizeof name - 1);
#ifdef REFUSES
    callbacks.log(callbacks.environment, name, 3, "e", "no licence");
    return 0;
#endif
#ifdef DIES
    ruin(SEGFAULT);
#endif
    return &me;
}
void fmi2FreeInstance(component c)
{
    (void)c;
    if (me.how == IN_FREE) ruin(SEGFAULT);
    if (me.how == FORK_BESIDE) fork();
}
int fmi2SetupExperiment(component c, int a, double b, double t, int d, double e)
{
    (void)c, (void)a, (void)b, (void)d, (void)e;
    me.t = t;
    return 0;
}
static void into_all(const char *text, size_t n) { for (int i = 3; i < 4096; i++) write(i, text, n); }
int fmi2EnterInitializationMode(component c)
{
    (void)c;
    if (me.how == IN_START) ruin(SEGFAULT);
    if (me.how == START_NEGATIVE) return -1;
    if (me.how == FORK_BESIDE) fork();
    if (me.how == SCRIBBLE_EARLY) into_all("\0\0\0\4abcd", 8); /* a message of four letters */
    if (me.how == SCRIBBLE_LONG) into_all("\0\1\0\0", 4); /* a message of 65,536, which does not come */
    /* a message that is code: builtins.exit(7), pickled */
    if (me.how == SCRIBBLE_CODE) into_all("\0\0\0\26cbuiltins\nexit\n(I7\ntR.", 26);
    return 0;
}
int fmi2ExitInitializationMode(component c) { (void)c; if (me.how == IN_EXIT) ruin(EXIT_0); return 0; }
int fmi2SetInteger(component c, const unsigned *r, size_t n, const int *v)
{
    (void)c, (void)r;
    if (n) me.how = v[0];
    return 0;
}
int fmi2GetReal(component c, const unsigned *r, size_t n, double *v)
{
    (void)c, (void)r;
    for (size_t i = 0; i < n; i++) v[i] = me.y;
    return me.how == READ_WARNS && me.t > 3.5;
}
int fmi2DoStep(component c, double t, double dt, int no)
{
    (void)c, (void)no;
    me.t = t + dt;
    me.y = me.t;
    if (me.how == DISCARD && t > 2.5 && dt > 0.3) return me.y = -1.0, 2;
    if (me.how == SLOW) usleep(20000);
    if (me.how == PRINT) printf("{not json}\n"), fflush(stdout);
    if (t < 2.5) return 0;
    ruin(me.how);
    if (me.how == FORK && t < 3.5) fork();
    if (me.how == STAY && t < 3.5 && !fork()) prctl(PR_SET_NAME, daemon_name()), sleep(600);
    if (me.how == LEAVE && !fork()) sleep(2), _exit(0);
    if (me.how == LEAVE) ruin(SEGFAULT);
    if (me.how == SCRIBBLE) into_all("scribble", 8);  // what it finds open is not its own
    if (me.how == DOT) into_all(".", 1), usleep(50000);  // what says that a step is made
    if (me.how == KILL_GROUP) kill(0, SIGKILL);
    if (me.how == DAEMON && t < 3.5 && !fork()) {
        setsid();
        if (!fork()) prctl(PR_SET_NAME, daemon_name()), sleep(600);
        _exit(0);
    }
    if (me.how == TRAPS) feenableexcept(FE_INVALID);
#ifdef __SSE__
    if (me.how == FLUSHED) _mm_setcsr(_mm_getcsr() | 0x8040); /* subnormal numbers are 0 */
#endif
    if (me.how == UMASK) umask(0777);
    if (me.how == ROUNDED && fegetround() == FE_UPWARD) me.y += 0.5;
    if (me.how == ROUNDED && t < 3.5) fesetround(FE_UPWARD);
    if (me.how == NOT_FINITE) me.y = NAN;
    if (me.how == CHDIR && chdir("/")) return 3;
    if (me.how == ROUNDING) fesetround(FE_UPWARD);
    if (me.how == LOCALE) setlocale(LC_ALL, strcmp(setlocale(LC_ALL, 0), "C") ? "C" : "C.UTF-8");
    if (me.how == HANDLER) signal(SIGPIPE, SIG_DFL), signal(SIGFPE, SIG_IGN);
    if (me.how == LOG && t < 3.5)
        callbacks.log(callbacks.environment, name, 1, "w", "low \033[31mpressure at %g", t);
    if (me.how == ASKS_END) return me.t = t + 0.5, 2;
    return me.how == STEP_WARNS ? 1 : me.how == STEP_ERROR ? 3 : me.how == FATAL ? 4 : me.how == NEGATIVE ? -1 : 0;
}
/* of status 2 the time of its last success, of 3 whether it wants to end */
int fmi2GetRealStatus(component c, int of, double *v) { (void)c; return of == 2 ? *v = me.t, 0 : 3; }
int fmi2GetBooleanStatus(component c, int of, int *v)
{
    (void)c;
    return of == 3 ? *v = me.how == ASKS_END, 0 : 3;
}
int fmi2Terminate(component c)
{
    (void)c;
    if (me.how == ENDS_BADLY) callbacks.log(callbacks.environment, name, 3, "e", "not now");
    return me.how == ENDS_BADLY ? 3 : 0;
}
int fmi2GetFMUstate(component c, void **state)
{
    (void)c;
    if (*state == NULL) *state = malloc(sizeof me);
    memcpy(*state, &me, sizeof me);
    return 0;
}
int fmi2SetFMUstate(component c, void *state) { (void)c; memcpy(&me, state, sizeof me); return 0; }
int fmi2FreeFMUstate(component c, void **state) { (void)c; free(*state); *state = NULL; return 0; }
int fmi2SerializedFMUstateSize(component c, void *state, size_t *n) { (void)c, (void)state; *n = sizeof me; return 0; }
int fmi2SerializeFMUstate(component c, void *state, char *to, size_t n) { (void)c; memcpy(to, state, n); return 0; }
int fmi2DeSerializeFMUstate(component c, const char *from, size_t n, void **state)
{
    (void)c;
    memcpy(*state = malloc(n), from, n);
    return 0;
}
#define NONE(name) int name() { return 0; }
NONE(fmi2SetDebugLogging) NONE(fmi2Reset) NONE(fmi2GetInteger)
NONE(fmi2GetBoolean) NONE(fmi2GetString) NONE(fmi2SetReal) NONE(fmi2SetBoolean) NONE(fmi2SetString)
NONE(fmi2GetDirectionalDerivative)
NONE(fmi2SetRealInputDerivatives) NONE(fmi2GetRealOutputDerivatives) NONE(fmi2CancelStep)
NONE(fmi2GetStatus) NONE(fmi2GetIntegerStatus)
NONE(fmi2GetStringStatus)
