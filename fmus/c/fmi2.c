/* FMI 2.0 for co-simulation, for every block. What it does is what fmus/slave.py does for the Python
   FMUs: the outputs follow inputs and parameters in initialisation mode; what fails is logged, sets
   the output `fault`, and lets no further step begin. */

#include "fmi2.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct {
    uint32_t magic;
    fmi2_progress now;
    char self[];
} fmi2_saved;

static const block_description *const fmi2_block = &desat_the_block;

/* of the block's bytes, with those of its parts */
static size_t fmi2_whole(void)
{
    size_t size = fmi2_block->part_count ? block_room(fmi2_block->size) : fmi2_block->size;
    for (size_t k = 0; k < fmi2_block->part_count; k++)
        size += block_room(fmi2_block->parts[k]->size);
    return size;
}

/* of the states of this FMU */
static uint32_t fmi2_magic(void)
{
    uint32_t sum = 0x64736174;
    for (const char *p = fmi2_block->guid; *p; p++) sum = (sum ^ (unsigned char)*p) * 16777619u;
    return sum;
}

static bool *fmi2_fault_of(fmi2_instance *c)
{
    return (bool *)((char *)c->self + fmi2_block->fault);
}

static void fmi2_say(const fmi2_instance *c, fmi2Status status, const char *text)
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

static fmi2Status fmi2_fail(fmi2_instance *c, const char *what, const char *error, const char *text)
{
    char message[1400];
    *fmi2_fault_of(c) = true;
    snprintf(message, sizeof message, "%s: %s: %s%s%s", c->name, what, error, *error ? ": " : "",
             text);
    fmi2_say(c, fmi2Error, message);
    return fmi2Error;
}

/* raises BlockError where a parameter is outside its bounds or not finite */
static void fmi2_check(const fmi2_instance *c)
{
    for (size_t k = 0; k < fmi2_block->count; k++) {
        const block_variable *v = &fmi2_block->variables[k];
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
static void fmi2_refresh(fmi2_instance *c, bool ends)
{
    py_frame frame;
    if (ends && c->now.unstarted) c->now.stale = true;
    if (!c->now.stale || c->now.phase != FMI2_INITIALISING) return;
    c->now.stale = false;
    if (c->now.unstarted) *fmi2_fault_of(c) = c->now.unstarted = false; /* inputs may have settled */
    if (PY_TRY(frame)) {
        fmi2_check(c);
        fmi2_block->start(c->self);
        fmi2_block->output(c->self, c->now.time);
        py_end_try();
    } else {
        c->now.unstarted = !*fmi2_fault_of(c);
        *fmi2_fault_of(c) = true;
        if (ends) fmi2_fail(c, "start", py_caught_name(), py_caught_text());
    }
}

/* the path of the file of start values in the folder of the resources, a URI or a path */
static bool fmi2_start_file(const char *resources, char *path, size_t room)
{
    const char *const file = "/start.txt";
    size_t n = 0;
    const bool uri = strncmp(resources, "file:", 5) == 0;
    if (uri) {
        resources += 5;
        if (strncmp(resources, "//", 2) == 0) resources += 2;
        if (strncmp(resources, "localhost/", 10) == 0) resources += 9;
#ifdef _WIN32
        if (*resources == '/') resources++; /* /C:/... */
#endif
    }
    for (const char *p = resources; *p && n + 1 < room; p++) {
        unsigned code;
        if (uri && *p == '%' && sscanf(p + 1, "%2x", &code) == 1) path[n++] = (char)code, p += 2;
        else path[n++] = *p;
    }
    while (n > 0 && path[n - 1] == '/') n--;
    if (n + strlen(file) + 1 > room) return false;
    memcpy(path + n, file, strlen(file) + 1);
    return true;
}

/* read the start values of a copy; its guid is compared with that given */
static bool fmi2_read_starts(fmi2_instance *c, const char *resources, const char *guid)
{
    char path[4096], line[512];
    bool known = false;
    size_t room = 0;
    FILE *file;
    if (resources == NULL || !fmi2_start_file(resources, path, sizeof path)) return false;
    if ((file = fopen(path, "r")) == NULL) return false;
    while (fgets(line, sizeof line, file) != NULL) {
        unsigned reference;
        int at = 0;
        line[strcspn(line, "\r\n")] = 0;
        if (strncmp(line, "guid ", 5) == 0) known = strcmp(line + 5, guid) == 0;
        if (!known || sscanf(line + 1, " %u %n", &reference, &at) < 1 || at == 0) continue;
        if (strchr("RIB", line[0]) == NULL || reference >= fmi2_block->count
            || c->places[reference].kind != line[0])
            continue;
        if (c->start_count == room) {
            struct fmi2_start *more = realloc(c->starts, (room += 64) * sizeof *more);
            if (more == NULL) break;
            c->starts = more;
        }
        c->starts[c->start_count] = (struct fmi2_start){ reference, 0.0 };
        if (line[0] == 'R') {
            const uint64_t bits = strtoull(line + 1 + at, NULL, 16);
            memcpy(&c->starts[c->start_count].value, &bits, sizeof bits);
        } else c->starts[c->start_count].value = (double)strtoll(line + 1 + at, NULL, 10);
        c->start_count++;
    }
    fclose(file);
    return known;
}

static void fmi2_begin(fmi2_instance *c)
{
    memset(c->self, 0, fmi2_whole());
    memcpy(c->self, fmi2_block->at_start, fmi2_block->size);
    for (size_t k = 0; k < c->start_count; k++) {
        const fmi2_place *at = c->places + c->starts[k].reference;
        void *value = (char *)c->self + at->offset;
        if (at->kind == 'R') *(double *)value = c->starts[k].value;
        else if (at->kind == 'I') *(int64_t *)value = (int64_t)c->starts[k].value;
        else *(bool *)value = c->starts[k].value != 0.0;
    }
    *(const char **)c->self = c->key;
    memset(&c->now, 0, sizeof c->now);
    c->now.phase = FMI2_INSTANTIATED;
    c->stop = INFINITY;
}

/* the instance's name; of a file's, which Ecos gives with its path and fmucontainer after that of the
   container (c.wheels.fmu), the stem alone */
static char *fmi2_key_of(const char *name)
{
    size_t n = strlen(name);
    const char *from = name;
    char *key;
    if (n >= 4 && strcmp(name + n - 4, ".fmu") == 0) {
        n -= 4;
        for (const char *p = name; p < name + n; p++)
            if (*p == '/' || *p == '\\' || *p == '.') from = p + 1;
        n = (size_t)(name + n - from);
    }
    key = calloc(n + 1, 1);
    if (key != NULL) memcpy(key, from, n);
    return key;
}

/* of the array that variable k begins, by the names: those of `a[1]`, `a[2]`, ... follow each other */
static uint16_t fmi2_elements(size_t k)
{
    const char *name = fmi2_block->variables[k].name;
    const size_t length = strcspn(name, "[");
    size_t end = k + 1;
    if (name[length] == 0) return 1;
    if (k > 0 && strncmp(fmi2_block->variables[k - 1].name, name, length + 1) == 0) return 0;
    while (end < fmi2_block->count
           && strncmp(fmi2_block->variables[end].name, name, length + 1) == 0)
        end++;
    return (uint16_t)(end - k);
}

/* --- life -------------------------------------------------------------------------------------------- */

FMI2_EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
FMI2_EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

FMI2_EXPORT fmi2Status fmi2SetDebugLogging(fmi2Component p, fmi2Boolean on, size_t n,
                                      const fmi2String categories[])
{
    (void)on, (void)n, (void)categories;
    return p == NULL ? fmi2Error : fmi2OK;
}

FMI2_EXPORT void fmi2FreeInstance(fmi2Component p)
{
    fmi2_instance *c = p;
    if (c == NULL) return;
    free(c->self);
    free(c->places);
    free(c->starts);
    free(c->name);
    free(c->key);
    free(c);
}

/* whether a description has all variables as Real (fmus/reals.py) */
static bool fmi2_is_of_reals(const char *guid)
{
    const size_t size = strlen(fmi2_block->guid);
    return strncmp(guid, fmi2_block->guid, size) == 0 && strcmp(guid + size, "-reals") == 0;
}

FMI2_EXPORT fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                                     fmi2String resources, const fmi2CallbackFunctions *call,
                                     fmi2Boolean visible, fmi2Boolean logging)
{
    fmi2_instance *c = calloc(1, sizeof *c);
    (void)visible, (void)logging;
    if (c == NULL) return NULL;
    if (call != NULL) c->call = *call;
    name = name != NULL ? name : "";
    c->name = calloc(strlen(name) + 1, 1);
    c->key = fmi2_key_of(name);
    c->self = malloc(fmi2_whole());
    c->places = malloc(fmi2_block->count * sizeof *c->places);
    if (c->name == NULL || c->key == NULL || c->self == NULL || c->places == NULL) {
        fmi2FreeInstance(c);
        return NULL;
    }
    for (size_t k = 0; k < fmi2_block->count; k++) {
        const block_variable *v = fmi2_block->variables + k;
        c->places[k] = (fmi2_place){ (uint32_t)v->offset, v->kind,
                                v->causality == 'p' ? FMI2_PARAMETER
                                : v->causality == 'o' ? FMI2_OUTPUT : 0, fmi2_elements(k) };
    }
    strcpy(c->name, name);
    c->reals = guid != NULL && fmi2_is_of_reals(guid);
    if (type != fmi2CoSimulation || guid == NULL
        || (strcmp(guid, fmi2_block->guid) != 0 && !c->reals && !fmi2_read_starts(c, resources, guid))) {
        fmi2_say(c, fmi2Error, type != fmi2CoSimulation ? "it is for co-simulation only"
                                                   : "the guid is that of another FMU");
        fmi2FreeInstance(c);
        return NULL;
    }
    fmi2_begin(c);
    return c;
}

FMI2_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component p, fmi2Boolean with_tolerance,
                                      fmi2Real tolerance, fmi2Real start, fmi2Boolean with_stop,
                                      fmi2Real stop)
{
    fmi2_instance *c = p;
    char text[120];
    (void)with_tolerance, (void)tolerance;
    if (c == NULL) return fmi2Error;
    if (c->now.phase != FMI2_INSTANTIATED)
        return fmi2_fail(c, "set up the experiment", "RuntimeError", "it has begun");
    if (!isfinite(start) || (with_stop && !(start <= stop))) {
        py_text_begin();
        py_text(isfinite(start) ? "a stop at t = " : "a start at t = ");
        py_text_float(isfinite(start) ? stop : start);
        py_text(" s");
        if (isfinite(start)) {
            py_text(", with a start at t = ");
            py_text_float(start);
            py_text(" s");
        }
        snprintf(text, sizeof text, "%s", py_text_end());
        return fmi2_fail(c, "set up the experiment", "RuntimeError", text);
    }
    c->now.time = start;
    c->stop = with_stop ? stop : INFINITY;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component p)
{
    fmi2_instance *c = p;
    if (c == NULL) return fmi2Error;
    if (c->now.phase != FMI2_INSTANTIATED)
        return fmi2_fail(c, "enter initialisation", "RuntimeError", "it was entered before");
    c->now.phase = FMI2_INITIALISING;
    c->now.stale = true;
    return fmi2OK;
}

/* a warning where the block could not start: the log says why, and the output `fault` is true */
FMI2_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component p)
{
    fmi2_instance *c = p;
    if (c == NULL) return fmi2Error;
    if (c->now.phase == FMI2_INSTANTIATED)
        return fmi2_fail(c, "leave initialisation", "RuntimeError", "it was not entered");
    fmi2_refresh(c, true);
    c->now.phase = FMI2_STEPPING;
    return *fmi2_fault_of(c) ? fmi2Warning : fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2Terminate(fmi2Component p)
{
    fmi2_instance *c = p;
    if (c == NULL) return fmi2Error;
    if (c->now.phase == FMI2_TERMINATED)
        return fmi2_fail(c, "terminate", "RuntimeError", "it was before");
    c->now.phase = FMI2_TERMINATED;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2Reset(fmi2Component p)
{
    fmi2_instance *c = p;
    if (c == NULL) return fmi2Error;
    fmi2_begin(c);
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2DoStep(fmi2Component p, fmi2Real t, fmi2Real dt, fmi2Boolean no_set_prior)
{
    fmi2_instance *c = p;
    py_frame frame;
    char what[80];
    (void)no_set_prior;
    if (c == NULL) return fmi2Error;
    if (*fmi2_fault_of(c)) return fmi2Discard;
    if (PY_TRY(frame)) {
        if (c->now.phase != FMI2_STEPPING) py_raise(PY_RUNTIME_ERROR, "a step outside step mode");
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
        if (t + dt > c->stop + 1e-6 * dt) {
            py_text_begin();
            py_text("a step to t = ");
            py_text_float(t + dt);
            py_text(" s, beyond the stop at t = ");
            py_text_float(c->stop);
            py_text(" s");
            py_raise(PY_RUNTIME_ERROR, py_text_end());
        }
        fmi2_block->advance(c->self, t, dt);
        c->now.time = t + dt;
        fmi2_block->output(c->self, c->now.time);
        py_end_try();
        return fmi2OK;
    }
    py_text_begin();
    py_text("step from t = ");
    py_text_float(t);
    py_text(" s");
    snprintf(what, sizeof what, "%s", py_text_end());
    fmi2_fail(c, what, py_caught_name(), py_caught_text());
    return fmi2Discard;
}

FMI2_EXPORT fmi2Status fmi2CancelStep(fmi2Component p)
{
    (void)p;
    return fmi2Error;
}

/* --- values ------------------------------------------------------------------------------------------ */

static const char *const FMI2_KINDS[] = { ['R'] = "Real", ['I'] = "Integer", ['B'] = "Boolean" };

static fmi2Status fmi2_not_there(fmi2_instance *c, const char *verb, char kind, fmi2ValueReference vr)
{
    char what[20], text[300];
    snprintf(what, sizeof what, "%s %s", verb, FMI2_KINDS[(int)kind]);
    if (vr >= fmi2_block->count) return fmi2_fail(c, what, "IndexError", "list index out of range");
    snprintf(text, sizeof text, "value reference %u (%.*s) is not %s", vr,
             (int)strcspn(fmi2_block->variables[vr].name, "["), fmi2_block->variables[vr].name,
             FMI2_KINDS[(int)kind]);
    return fmi2_fail(c, what, "TypeError", text);
}

/* an Integer or Boolean where all variables are Reals: its value, whether it can have one, and that */
static double fmi2_as_real(const fmi2_place *at, const char *self)
{
    return at->kind == 'I' ? (double)*(const int64_t *)(self + at->offset)
                           : (double)*(const bool *)(self + at->offset);
}

static const char *fmi2_refused(const fmi2_place *at, double x)
{
    if (at->kind == 'B') return x == 0.0 || x == 1.0 ? NULL : "0 or 1 is needed";
    return x == (double)(int64_t)x && fabs(x) < 9e15 ? NULL : "a whole number is needed";
}

static void fmi2_put_real(const fmi2_place *at, char *self, double x)
{
    if (at->kind == 'I') *(int64_t *)(self + at->offset) = (int64_t)x;
    else *(bool *)(self + at->offset) = x != 0.0;
}

#define FMI2_GET(FUNCTION, TYPE, KIND, MEMBER, FAILED)                                              \
    FMI2_EXPORT fmi2Status FUNCTION(fmi2Component p, const fmi2ValueReference vr[], size_t n,       \
                               TYPE value[])                                                        \
    {                                                                                               \
        fmi2_instance *c = p;                                                                       \
        const size_t count = fmi2_block->count;                                                     \
        const fmi2_place *at;                                                                       \
        const char *self;                                                                           \
        if (c == NULL || (n > 0 && (vr == NULL || value == NULL))) return fmi2Error;                \
        if (c->now.stale) fmi2_refresh(c, false);                                                   \
        at = c->places, self = c->self;                                                             \
        for (size_t k = 0; k < n; k++) {                                                            \
            const fmi2ValueReference r = vr[k];                                                     \
            if (PY_RARE(r >= count || at[r].kind != KIND)) {                                        \
                if (KIND == 'R' && c->reals && r < count) {                                         \
                    value[k] = (TYPE)fmi2_as_real(at + r, self);                                    \
                    continue;                                                                       \
                }                                                                                   \
                for (k = n; k-- > 0;) value[k] = FAILED;                                            \
                for (k = 0; vr[k] < count && at[vr[k]].kind == KIND;) k++;                          \
                return fmi2_not_there(c, "get", KIND, vr[k]);                                       \
            }                                                                                       \
            value[k] = (TYPE)*(const MEMBER *)(self + at[r].offset);                                \
            if (KIND == 'I' && PY_RARE(value[k] != *(const MEMBER *)(self + at[r].offset)))         \
                return fmi2_fail(c, "get Integer", fmi2_block->variables[r].name, "beyond 32 bits"); \
        }                                                                                           \
        return fmi2OK;                                                                              \
    }

static fmi2Status fmi2_not_set(fmi2_instance *c, char kind, fmi2ValueReference vr, const char *why)
{
    char what[20], text[200];
    snprintf(what, sizeof what, "set %s", FMI2_KINDS[(int)kind]);
    snprintf(text, sizeof text, "%s: %s", fmi2_block->variables[vr].name, why);
    return fmi2_fail(c, what, "ValueError", text);
}

static fmi2Status fmi2_output_set(fmi2_instance *c, char kind, const fmi2ValueReference vr[], size_t n)
{
    size_t k = 0;
    while (k + 1 < n && c->places[vr[k]].fixed != FMI2_OUTPUT) k++;
    return fmi2_not_set(c, kind, vr[k], "an output is not set");
}

#define FMI2_SET(FUNCTION, TYPE, KIND, MEMBER, GIVEN)                                               \
    FMI2_EXPORT fmi2Status FUNCTION(fmi2Component p, const fmi2ValueReference vr[], size_t n,       \
                               const TYPE value[])                                                  \
    {                                                                                               \
        fmi2_instance *c = p;                                                                       \
        const size_t count = fmi2_block->count;                                                     \
        const fmi2_place *at;                                                                       \
        char *self;                                                                                 \
        int fixed = 0;                                                                              \
        if (c == NULL || (n > 0 && (vr == NULL || value == NULL))) return fmi2Error;                \
        at = c->places, self = c->self;                                                             \
        for (size_t k = 0; k < n; k++) {                                                            \
            if (PY_RARE(vr[k] >= count || (at[vr[k]].kind != KIND && !(KIND == 'R' && c->reals))))  \
                return fmi2_not_there(c, "set", KIND, vr[k]);                                       \
            if (PY_RARE(value[k] - value[k] != 0))                                                  \
                return fmi2_not_set(c, KIND, vr[k], value[k] != value[k] ? "nan is no number"       \
                                                    : value[k] > 0 ? "inf is no number"             \
                                                    : "-inf is no number");                         \
            if (PY_RARE(at[vr[k]].kind != KIND && fmi2_refused(at + vr[k], (double)value[k])))      \
                return fmi2_not_set(c, KIND, vr[k], fmi2_refused(at + vr[k], (double)value[k]));    \
            fixed |= at[vr[k]].fixed;                                                               \
        }                                                                                           \
        if (PY_RARE(fixed & FMI2_OUTPUT)) return fmi2_output_set(c, KIND, vr, n);                   \
        if (fixed && c->now.phase >= FMI2_STEPPING) return fmi2_is_fixed(c, KIND, vr, n);           \
        for (size_t k = 0; k < n; k++) {                                                            \
            if (PY_RARE(at[vr[k]].kind != KIND)) fmi2_put_real(at + vr[k], self, (double)value[k]); \
            else *(MEMBER *)(self + at[vr[k]].offset) = GIVEN;                                      \
        }                                                                                           \
        c->now.stale = c->now.phase == FMI2_INITIALISING;                                           \
        return fmi2OK;                                                                              \
    }

/* names as Python gives them: of an array once, without its index */
static fmi2Status fmi2_is_fixed(fmi2_instance *c, char kind, const fmi2ValueReference vr[], size_t n)
{
    char what[20], text[900] = "", name[120], last[120] = "";
    size_t used = 0;
    for (size_t k = 0; k < n && used < 700; k++) {
        snprintf(name, sizeof name, "%s", fmi2_block->variables[vr[k]].name);
        if (strchr(name, '[') != NULL) *strchr(name, '[') = 0;
        if (strcmp(name, last) == 0) continue;
        used += (size_t)snprintf(text + used, sizeof text - used, "%s%s", used ? ", " : "", name);
        memcpy(last, name, sizeof last);
    }
    snprintf(text + used, sizeof text - used,
             ": a parameter is fixed once the simulation runs");
    snprintf(what, sizeof what, "set %s", FMI2_KINDS[(int)kind]);
    return fmi2_fail(c, what, "RuntimeError", text);
}

FMI2_GET(fmi2GetReal, fmi2Real, 'R', double, NAN)
FMI2_GET(fmi2GetInteger, fmi2Integer, 'I', int64_t, 0)
FMI2_GET(fmi2GetBoolean, fmi2Boolean, 'B', bool, 0)
FMI2_SET(fmi2SetReal, fmi2Real, 'R', double, value[k])
FMI2_SET(fmi2SetInteger, fmi2Integer, 'I', int64_t, value[k])
FMI2_SET(fmi2SetBoolean, fmi2Boolean, 'B', bool, value[k] != 0)

/* Not of the standard: where the values of variables of one kind (R: double, I: int64_t, B: bool) lie
   while an instance lives, parameters excepted, for a master in C that moves them itself in step mode,
   when get and set do no more than that. False where one is not there. */
FMI2_EXPORT bool desat_places(fmi2Component p, char kind, const fmi2ValueReference vr[], size_t n,
                         void *found[])
{
    const fmi2_instance *c = p;
    for (size_t k = 0; k < n; k++) {
        if (vr[k] >= fmi2_block->count || c->places[vr[k]].kind != kind
            || c->places[vr[k]].fixed == FMI2_PARAMETER)
            return false;
        found[k] = (char *)c->self + c->places[vr[k]].offset;
    }
    return true;
}

FMI2_EXPORT fmi2Status fmi2GetString(fmi2Component p, const fmi2ValueReference vr[], size_t n,
                                fmi2String value[])
{
    (void)vr;
    for (size_t k = 0; value != NULL && k < n; k++) value[k] = "";
    if (p != NULL && n == 0) return fmi2OK;
    return p == NULL ? fmi2Error : fmi2_fail(p, "get String", "", "there are no strings here");
}

FMI2_EXPORT fmi2Status fmi2SetString(fmi2Component p, const fmi2ValueReference vr[], size_t n,
                                const fmi2String value[])
{
    (void)vr, (void)value;
    if (p != NULL && n == 0) return fmi2OK;
    return p == NULL ? fmi2Error : fmi2_fail(p, "set String", "", "there are no strings here");
}

/* --- state: bytes, of this FMU only, for its guid goes with them ------------------------------------- */

FMI2_EXPORT fmi2Status fmi2GetFMUstate(fmi2Component p, fmi2FMUstate *state)
{
    fmi2_instance *c = p;
    fmi2_saved *s;
    if (c == NULL || state == NULL) return fmi2Error;
    s = *state != NULL ? *state : calloc(1, sizeof *s + fmi2_whole());
    if (s == NULL) return fmi2_fail(c, "get state", "", "no memory");
    s->magic = fmi2_magic();
    s->now = c->now;
    memcpy(s->self, c->self, fmi2_whole());
    memset(s->self, 0, sizeof c->key); /* the name is the instance's */
    *state = s;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2SetFMUstate(fmi2Component p, fmi2FMUstate state)
{
    fmi2_instance *c = p;
    const fmi2_saved *s = state;
    if (c == NULL) return fmi2Error;
    if (s == NULL || s->magic != fmi2_magic())
        return fmi2_fail(c, "set state", "", "this is no state of this FMU");
    c->now = s->now;
    memcpy(c->self, s->self, fmi2_whole());
    *(const char **)c->self = c->key;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component p, fmi2FMUstate *state)
{
    (void)p;
    if (state == NULL) return fmi2Error;
    free(*state);
    *state = NULL;
    return fmi2OK;
}

static size_t fmi2_guid_size(void) { return strlen(fmi2_block->guid); }

FMI2_EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component p, fmi2FMUstate state, size_t *size)
{
    if (p == NULL || state == NULL || size == NULL) return fmi2Error;
    *size = fmi2_guid_size() + sizeof(fmi2_saved) + fmi2_whole();
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component p, fmi2FMUstate state, fmi2Byte bytes[],
                                        size_t size)
{
    if (p == NULL || state == NULL || bytes == NULL) return fmi2Error;
    if (size < fmi2_guid_size() + sizeof(fmi2_saved) + fmi2_whole())
        return fmi2_fail(p, "serialise state", "", "too few bytes");
    memcpy(bytes, fmi2_block->guid, fmi2_guid_size());
    memcpy(bytes + fmi2_guid_size(), state, sizeof(fmi2_saved) + fmi2_whole());
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component p, const fmi2Byte bytes[], size_t size,
                                          fmi2FMUstate *state)
{
    fmi2_saved *s;
    if (p == NULL || state == NULL || bytes == NULL) return fmi2Error;
    if (size != fmi2_guid_size() + sizeof(fmi2_saved) + fmi2_whole()
        || memcmp(bytes, fmi2_block->guid, fmi2_guid_size()) != 0)
        return fmi2_fail(p, "deserialise state", "", "these are not the bytes of a state of this FMU");
    s = *state != NULL ? *state : calloc(1, sizeof *s + fmi2_whole());
    if (s == NULL) return fmi2_fail(p, "deserialise state", "", "no memory");
    memcpy(s, bytes + fmi2_guid_size(), sizeof(fmi2_saved) + fmi2_whole());
    *state = s;
    return fmi2OK;
}

/* --- what there is not ------------------------------------------------------------------------------- */

FMI2_EXPORT fmi2Status fmi2GetDirectionalDerivative(fmi2Component p, const fmi2ValueReference unknown[],
                                               size_t n, const fmi2ValueReference known[], size_t m,
                                               const fmi2Real given[], fmi2Real found[])
{
    (void)p, (void)unknown, (void)n, (void)known, (void)m, (void)given, (void)found;
    return fmi2Error;
}

FMI2_EXPORT fmi2Status fmi2SetRealInputDerivatives(fmi2Component p, const fmi2ValueReference vr[],
                                              size_t n, const fmi2Integer order[],
                                              const fmi2Real value[])
{
    (void)p, (void)vr, (void)n, (void)order, (void)value;
    return fmi2Error;
}

FMI2_EXPORT fmi2Status fmi2GetRealOutputDerivatives(fmi2Component p, const fmi2ValueReference vr[],
                                               size_t n, const fmi2Integer order[],
                                               fmi2Real value[])
{
    (void)p, (void)vr, (void)n, (void)order, (void)value;
    return fmi2Error;
}

FMI2_EXPORT fmi2Status fmi2GetStatus(fmi2Component p, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)p, (void)kind, (void)value;
    return fmi2Discard;
}

FMI2_EXPORT fmi2Status fmi2GetRealStatus(fmi2Component p, const fmi2StatusKind kind, fmi2Real *value)
{
    const fmi2_instance *c = p;
    if (c == NULL || value == NULL || kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = c->now.time;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2GetIntegerStatus(fmi2Component p, const fmi2StatusKind kind,
                                       fmi2Integer *value)
{
    (void)p, (void)kind, (void)value;
    return fmi2Discard;
}

FMI2_EXPORT fmi2Status fmi2GetBooleanStatus(fmi2Component p, const fmi2StatusKind kind,
                                       fmi2Boolean *value)
{
    const fmi2_instance *c = p;
    if (c == NULL || value == NULL || kind != fmi2Terminated) return fmi2Discard;
    *value = c->now.phase == FMI2_TERMINATED;
    return fmi2OK;
}

FMI2_EXPORT fmi2Status fmi2GetStringStatus(fmi2Component p, const fmi2StatusKind kind, fmi2String *value)
{
    (void)p, (void)kind, (void)value;
    return fmi2Discard;
}
