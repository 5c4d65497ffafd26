/* FMI 2.0 for co-simulation, for every block. What it does is what fmus/slave.py does for the Python
   FMUs: the outputs follow inputs and parameters in initialisation mode; what fails is logged, sets
   the output `fault`, and lets no further step begin. */

#include "fmi2.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct {
    uint32_t magic;
    progress now;
    char self[];
} saved;

static const block_description *const the = &the_block;

/* of the block's bytes, with those of its parts */
static size_t whole(void)
{
    size_t size = the->part_count ? block_room(the->size) : the->size;
    for (size_t k = 0; k < the->part_count; k++) size += block_room(the->parts[k]->size);
    return size;
}

/* of the states of this FMU */
static uint32_t magic(void)
{
    uint32_t sum = 0x64736174;
    for (const char *p = the->guid; *p; p++) sum = (sum ^ (unsigned char)*p) * 16777619u;
    return sum;
}

static bool *fault_of(instance *c) { return (bool *)((char *)c->self + the->fault); }

static void say(const instance *c, fmi2Status status, const char *text)
{
    char safe[2048]; /* the logger takes a format */
    size_t k = 0;
    if (c->call.logger == NULL) return;
    while (*text && k < sizeof safe - 2) {
        if (*text == '%') safe[k++] = '%';
        safe[k++] = *text++;
    }
    safe[k] = 0;
    c->call.logger(c->call.componentEnvironment, c->name, status, "logStatusError", safe);
}

static fmi2Status fail(instance *c, const char *what, const char *error, const char *text)
{
    char message[1400];
    *fault_of(c) = true;
    snprintf(message, sizeof message, "%s: %s: %s%s%s", c->name, what, error, *error ? ": " : "",
             text);
    say(c, fmi2Error, message);
    return fmi2Error;
}

/* raises BlockError where a parameter is outside its bounds or not finite */
static void check(const instance *c)
{
    for (size_t k = 0; k < the->count; k++) {
        const block_variable *v = &the->variables[k];
        const char *at = (const char *)c->self + v->offset;
        double x;
        bool finite;
        if (v->causality != 'p') continue;
        x = v->kind == 'R' ? *(const double *)at
          : v->kind == 'I' ? (double)*(const int64_t *)at : (double)*(const bool *)at;
        finite = isfinite(x);
        if (finite && !(x < v->low) && !(x > v->high)) continue;
        py_text_begin();
        py_text(v->name);
        py_text(" = ");
        if (v->kind == 'R') py_text_float(x);
        else py_text_int((int64_t)x);
        py_text(finite ? " is outside " : " is not a finite number");
        if (finite) py_text(v->bounds);
        py_raise(PY_BLOCK_ERROR, py_text_end());
    }
}

/* initialisation mode: bring the outputs up to date with inputs and parameters; that the block
   cannot start is logged when the mode ends: until then inputs may not have arrived */
static void refresh(instance *c, bool ends)
{
    py_frame frame;
    if (ends && c->now.unstarted) c->now.stale = true;
    if (!c->now.stale || c->now.phase != INITIALISING) return;
    c->now.stale = false;
    if (c->now.unstarted) *fault_of(c) = c->now.unstarted = false; /* inputs may have settled */
    if (PY_TRY(frame)) {
        check(c);
        the->start(c->self);
        the->output(c->self, c->now.time);
        py_end_try();
    } else {
        c->now.unstarted = !*fault_of(c);
        *fault_of(c) = true;
        if (ends) fail(c, "start", py_caught_name(), py_caught_text());
    }
}

static void begin(instance *c)
{
    memset(c->self, 0, whole());
    memcpy(c->self, the->at_start, the->size);
    *(const char **)c->self = c->key;
    memset(&c->now, 0, sizeof c->now);
    c->now.phase = INSTANTIATED;
}

/* the instance's name; of a path, as Ecos gives, the file's stem */
static char *key_of(const char *name)
{
    size_t n = strlen(name);
    const char *from = name;
    char *key;
    if (n >= 4 && strcmp(name + n - 4, ".fmu") == 0) {
        n -= 4;
        for (const char *p = name; p < name + n; p++)
            if (*p == '/' || *p == '\\') from = p + 1;
        n = (size_t)(name + n - from);
    }
    key = calloc(n + 1, 1);
    if (key != NULL) memcpy(key, from, n);
    return key;
}

/* of the array that variable k begins, by the names: those of `a[1]`, `a[2]`, ... follow each other */
static uint16_t elements(size_t k)
{
    const char *name = the->variables[k].name;
    const size_t length = strcspn(name, "[");
    size_t end = k + 1;
    if (name[length] == 0) return 1;
    if (k > 0 && strncmp(the->variables[k - 1].name, name, length + 1) == 0) return 0;
    while (end < the->count && strncmp(the->variables[end].name, name, length + 1) == 0) end++;
    return (uint16_t)(end - k);
}

/* --- life -------------------------------------------------------------------------------------------- */

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component p, fmi2Boolean on, size_t n,
                                      const fmi2String categories[])
{
    (void)on, (void)n, (void)categories;
    return p == NULL ? fmi2Error : fmi2OK;
}

EXPORT void fmi2FreeInstance(fmi2Component p)
{
    instance *c = p;
    if (c == NULL) return;
    free(c->self);
    free(c->places);
    free(c->name);
    free(c->key);
    free(c);
}

EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                                     fmi2String resources, const fmi2CallbackFunctions *call,
                                     fmi2Boolean visible, fmi2Boolean logging)
{
    instance *c = calloc(1, sizeof *c);
    (void)resources, (void)visible, (void)logging;
    if (c == NULL) return NULL;
    if (call != NULL) c->call = *call;
    name = name != NULL ? name : "";
    c->name = calloc(strlen(name) + 1, 1);
    c->key = key_of(name);
    c->self = malloc(whole());
    c->places = malloc(the->count * sizeof *c->places);
    if (c->name == NULL || c->key == NULL || c->self == NULL || c->places == NULL) {
        fmi2FreeInstance(c);
        return NULL;
    }
    for (size_t k = 0; k < the->count; k++) {
        const block_variable *v = the->variables + k;
        c->places[k] = (place){ (uint32_t)v->offset, v->kind,
                                v->causality == 'p' ? PARAMETER
                                : v->causality == 'o' ? OUTPUT : 0, elements(k) };
    }
    strcpy(c->name, name);
    if (type != fmi2CoSimulation || guid == NULL || strcmp(guid, the->guid) != 0) {
        say(c, fmi2Error, type != fmi2CoSimulation ? "it is for co-simulation only"
                                                   : "the guid is that of another FMU");
        fmi2FreeInstance(c);
        return NULL;
    }
    begin(c);
    return c;
}

EXPORT fmi2Status fmi2SetupExperiment(fmi2Component p, fmi2Boolean with_tolerance,
                                      fmi2Real tolerance, fmi2Real start, fmi2Boolean with_stop,
                                      fmi2Real stop)
{
    instance *c = p;
    (void)with_tolerance, (void)tolerance, (void)with_stop, (void)stop;
    if (c == NULL) return fmi2Error;
    if (c->now.phase != INSTANTIATED)
        return fail(c, "set up the experiment", "RuntimeError", "it has begun");
    c->now.time = start;
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component p)
{
    instance *c = p;
    if (c == NULL) return fmi2Error;
    if (c->now.phase != INSTANTIATED)
        return fail(c, "enter initialisation", "RuntimeError", "it was entered before");
    c->now.phase = INITIALISING;
    c->now.stale = true;
    return fmi2OK;
}

/* a warning where the block could not start: the log says why, and the output `fault` is true */
EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component p)
{
    instance *c = p;
    if (c == NULL) return fmi2Error;
    if (c->now.phase == INSTANTIATED)
        return fail(c, "leave initialisation", "RuntimeError", "it was not entered");
    refresh(c, true);
    c->now.phase = STEPPING;
    return *fault_of(c) ? fmi2Warning : fmi2OK;
}

EXPORT fmi2Status fmi2Terminate(fmi2Component p)
{
    instance *c = p;
    if (c == NULL) return fmi2Error;
    if (c->now.phase == TERMINATED) return fail(c, "terminate", "RuntimeError", "it was before");
    c->now.phase = TERMINATED;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(fmi2Component p)
{
    instance *c = p;
    if (c == NULL) return fmi2Error;
    begin(c);
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(fmi2Component p, fmi2Real t, fmi2Real dt, fmi2Boolean no_set_prior)
{
    instance *c = p;
    py_frame frame;
    char what[80];
    (void)no_set_prior;
    if (c == NULL) return fmi2Error;
    if (*fault_of(c)) return fmi2Discard;
    if (PY_TRY(frame)) {
        if (c->now.phase != STEPPING) py_raise(PY_RUNTIME_ERROR, "a step outside step mode");
        if (!(0.0 < dt && dt < INFINITY)) {
            py_text_begin();
            py_text("a step of ");
            py_text_float(dt);
            py_text(" s");
            py_raise(PY_RUNTIME_ERROR, py_text_end());
        }
        if (!(fabs(t - c->now.time) <= 1e-6 * dt)) {
            py_text_begin();
            py_text("a step from t = ");
            py_text_float(t);
            py_text(" s, but it is ");
            py_text_float(c->now.time);
            py_text(" s");
            py_raise(PY_RUNTIME_ERROR, py_text_end());
        }
        the->advance(c->self, t, dt);
        c->now.time = t + dt;
        the->output(c->self, c->now.time);
        py_end_try();
        return fmi2OK;
    }
    py_text_begin();
    py_text("step from t = ");
    py_text_float(t);
    py_text(" s");
    snprintf(what, sizeof what, "%s", py_text_end());
    fail(c, what, py_caught_name(), py_caught_text());
    return fmi2Discard;
}

EXPORT fmi2Status fmi2CancelStep(fmi2Component p)
{
    (void)p;
    return fmi2Error;
}

/* --- values ------------------------------------------------------------------------------------------ */

static const char *const KINDS[] = { ['R'] = "Real", ['I'] = "Integer", ['B'] = "Boolean" };

static fmi2Status not_there(instance *c, const char *verb, char kind, fmi2ValueReference vr)
{
    char what[20], text[300];
    snprintf(what, sizeof what, "%s %s", verb, KINDS[(int)kind]);
    if (vr >= the->count) return fail(c, what, "IndexError", "list index out of range");
    snprintf(text, sizeof text, "value reference %u (%.*s) is not %s", vr,
             (int)strcspn(the->variables[vr].name, "["), the->variables[vr].name,
             KINDS[(int)kind]);
    return fail(c, what, "TypeError", text);
}

#define GET(FUNCTION, TYPE, KIND, MEMBER, FAILED)                                                    \
    EXPORT fmi2Status FUNCTION(fmi2Component p, const fmi2ValueReference vr[], size_t n,             \
                               TYPE value[])                                                         \
    {                                                                                                \
        instance *c = p;                                                                             \
        const size_t count = the->count;                                                             \
        const place *at;                                                                             \
        const char *self;                                                                            \
        if (c == NULL || (n > 0 && (vr == NULL || value == NULL))) return fmi2Error;                 \
        if (c->now.stale) refresh(c, false);                                                        \
        at = c->places, self = c->self;                                                              \
        for (size_t k = 0; k < n; k++) {                                                             \
            const fmi2ValueReference r = vr[k];                                                      \
            if (PY_RARE(r >= count || at[r].kind != KIND)) {                                         \
                for (k = n; k-- > 0;) value[k] = FAILED;                                             \
                for (k = 0; vr[k] < count && at[vr[k]].kind == KIND;) k++;                           \
                return not_there(c, "get", KIND, vr[k]);                                             \
            }                                                                                        \
            value[k] = (TYPE)*(const MEMBER *)(self + at[r].offset);                                 \
            if (KIND == 'I' && PY_RARE(value[k] != *(const MEMBER *)(self + at[r].offset)))          \
                return fail(c, "get Integer", the->variables[r].name, "beyond 32 bits");             \
        }                                                                                            \
        return fmi2OK;                                                                               \
    }

static fmi2Status not_set(instance *c, char kind, fmi2ValueReference vr, const char *why)
{
    char what[20], text[200];
    snprintf(what, sizeof what, "set %s", KINDS[(int)kind]);
    snprintf(text, sizeof text, "%s: %s", the->variables[vr].name, why);
    return fail(c, what, "ValueError", text);
}

static fmi2Status output_set(instance *c, char kind, const fmi2ValueReference vr[], size_t n)
{
    size_t k = 0;
    while (k + 1 < n && c->places[vr[k]].fixed != OUTPUT) k++;
    return not_set(c, kind, vr[k], "an output is not set");
}

#define SET(FUNCTION, TYPE, KIND, MEMBER, GIVEN)                                                     \
    EXPORT fmi2Status FUNCTION(fmi2Component p, const fmi2ValueReference vr[], size_t n,             \
                               const TYPE value[])                                                   \
    {                                                                                                \
        instance *c = p;                                                                             \
        const size_t count = the->count;                                                             \
        const place *at;                                                                             \
        char *self;                                                                                  \
        int fixed = 0;                                                                               \
        if (c == NULL || (n > 0 && (vr == NULL || value == NULL))) return fmi2Error;                 \
        at = c->places, self = c->self;                                                              \
        for (size_t k = 0; k < n; k++) {                                                             \
            if (PY_RARE(vr[k] >= count || at[vr[k]].kind != KIND))                                   \
                return not_there(c, "set", KIND, vr[k]);                                             \
            if (PY_RARE(value[k] != value[k]))                                                       \
                return not_set(c, KIND, vr[k], "nan is no number");                                  \
            fixed |= at[vr[k]].fixed;                                                                \
        }                                                                                            \
        if (PY_RARE(fixed & OUTPUT)) return output_set(c, KIND, vr, n);                              \
        if (fixed && c->now.phase >= STEPPING) return is_fixed(c, KIND, vr, n);                      \
        for (size_t k = 0; k < n; k++) *(MEMBER *)(self + at[vr[k]].offset) = GIVEN;                 \
        c->now.stale = c->now.phase == INITIALISING;                                                 \
        return fmi2OK;                                                                               \
    }

/* names as Python gives them: of an array once, without its index */
static fmi2Status is_fixed(instance *c, char kind, const fmi2ValueReference vr[], size_t n)
{
    char what[20], text[900] = "", name[120], last[120] = "";
    size_t used = 0;
    for (size_t k = 0; k < n && used < 700; k++) {
        snprintf(name, sizeof name, "%s", the->variables[vr[k]].name);
        if (strchr(name, '[') != NULL) *strchr(name, '[') = 0;
        if (strcmp(name, last) == 0) continue;
        used += (size_t)snprintf(text + used, sizeof text - used, "%s%s", used ? ", " : "", name);
        memcpy(last, name, sizeof last);
    }
    snprintf(text + used, sizeof text - used,
             ": a parameter is fixed once the simulation runs");
    snprintf(what, sizeof what, "set %s", KINDS[(int)kind]);
    return fail(c, what, "RuntimeError", text);
}

GET(fmi2GetReal, fmi2Real, 'R', double, NAN)
GET(fmi2GetInteger, fmi2Integer, 'I', int64_t, 0)
GET(fmi2GetBoolean, fmi2Boolean, 'B', bool, 0)
SET(fmi2SetReal, fmi2Real, 'R', double, value[k])
SET(fmi2SetInteger, fmi2Integer, 'I', int64_t, value[k])
SET(fmi2SetBoolean, fmi2Boolean, 'B', bool, value[k] != 0)

/* Not of the standard: where the values of variables of one kind (R: double, I: int64_t, B: bool) lie
   while an instance lives, parameters excepted, for a master in C that moves them itself in step mode,
   when get and set do no more than that. False where one is not there. */
EXPORT bool desat_places(fmi2Component p, char kind, const fmi2ValueReference vr[], size_t n,
                         void *found[])
{
    const instance *c = p;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] >= the->count || c->places[vr[k]].kind != kind
            || c->places[vr[k]].fixed == PARAMETER)
            return false;
        found[k] = (char *)c->self + c->places[vr[k]].offset;
    }
    return true;
}

EXPORT fmi2Status fmi2GetString(fmi2Component p, const fmi2ValueReference vr[], size_t n,
                                fmi2String value[])
{
    (void)vr;
    for (size_t k = 0; value != NULL && k < n; k++) value[k] = "";
    if (p != NULL && n == 0) return fmi2OK;
    return p == NULL ? fmi2Error : fail(p, "get String", "", "there are no strings here");
}

EXPORT fmi2Status fmi2SetString(fmi2Component p, const fmi2ValueReference vr[], size_t n,
                                const fmi2String value[])
{
    (void)vr, (void)value;
    if (p != NULL && n == 0) return fmi2OK;
    return p == NULL ? fmi2Error : fail(p, "set String", "", "there are no strings here");
}

/* --- state: bytes, of this FMU only, for its guid goes with them ------------------------------------- */

EXPORT fmi2Status fmi2GetFMUstate(fmi2Component p, fmi2FMUstate *state)
{
    instance *c = p;
    saved *s;
    if (c == NULL || state == NULL) return fmi2Error;
    s = *state != NULL ? *state : calloc(1, sizeof *s + whole());
    if (s == NULL) return fail(c, "get state", "", "no memory");
    s->magic = magic();
    s->now = c->now;
    memcpy(s->self, c->self, whole());
    memset(s->self, 0, sizeof c->key); /* the name is the instance's */
    *state = s;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetFMUstate(fmi2Component p, fmi2FMUstate state)
{
    instance *c = p;
    const saved *s = state;
    if (c == NULL) return fmi2Error;
    if (s == NULL || s->magic != magic())
        return fail(c, "set state", "", "this is no state of this FMU");
    c->now = s->now;
    memcpy(c->self, s->self, whole());
    *(const char **)c->self = c->key;
    return fmi2OK;
}

EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component p, fmi2FMUstate *state)
{
    (void)p;
    if (state == NULL) return fmi2Error;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

static size_t guid_size(void) { return strlen(the->guid); }

EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component p, fmi2FMUstate state, size_t *size)
{
    if (p == NULL || state == NULL || size == NULL) return fmi2Error;
    *size = guid_size() + sizeof(saved) + whole();
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component p, fmi2FMUstate state, fmi2Byte bytes[],
                                        size_t size)
{
    if (p == NULL || state == NULL || bytes == NULL) return fmi2Error;
    if (size < guid_size() + sizeof(saved) + whole())
        return fail(p, "serialise state", "", "too few bytes");
    memcpy(bytes, the->guid, guid_size());
    memcpy(bytes + guid_size(), state, sizeof(saved) + whole());
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component p, const fmi2Byte bytes[], size_t size,
                                          fmi2FMUstate *state)
{
    saved *s;
    if (p == NULL || state == NULL || bytes == NULL) return fmi2Error;
    if (size != guid_size() + sizeof(saved) + whole()
        || memcmp(bytes, the->guid, guid_size()) != 0)
        return fail(p, "deserialise state", "", "these are not the bytes of a state of this FMU");
    s = *state != NULL ? *state : calloc(1, sizeof *s + whole());
    if (s == NULL) return fail(p, "deserialise state", "", "no memory");
    memcpy(s, bytes + guid_size(), sizeof(saved) + whole());
    *state = s;
    return fmi2OK;
}

/* --- what there is not ------------------------------------------------------------------------------- */

EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component p, const fmi2ValueReference unknown[],
                                               size_t n, const fmi2ValueReference known[], size_t m,
                                               const fmi2Real given[], fmi2Real found[])
{
    (void)p, (void)unknown, (void)n, (void)known, (void)m, (void)given, (void)found;
    return fmi2Error;
}

EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component p, const fmi2ValueReference vr[],
                                              size_t n, const fmi2Integer order[],
                                              const fmi2Real value[])
{
    (void)p, (void)vr, (void)n, (void)order, (void)value;
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component p, const fmi2ValueReference vr[],
                                               size_t n, const fmi2Integer order[],
                                               fmi2Real value[])
{
    (void)p, (void)vr, (void)n, (void)order, (void)value;
    return fmi2Error;
}

EXPORT fmi2Status fmi2GetStatus(fmi2Component p, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)p, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetRealStatus(fmi2Component p, const fmi2StatusKind kind, fmi2Real *value)
{
    const instance *c = p;
    if (c == NULL || value == NULL || kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = c->now.time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component p, const fmi2StatusKind kind,
                                       fmi2Integer *value)
{
    (void)p, (void)kind, (void)value;
    return fmi2Discard;
}

EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component p, const fmi2StatusKind kind,
                                       fmi2Boolean *value)
{
    const instance *c = p;
    if (c == NULL || value == NULL || kind != fmi2Terminated) return fmi2Discard;
    *value = c->now.phase == TERMINATED;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetStringStatus(fmi2Component p, const fmi2StatusKind kind, fmi2String *value)
{
    (void)p, (void)kind, (void)value;
    return fmi2Discard;
}
