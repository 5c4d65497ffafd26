/* FMI 3.0 for co-simulation: the other face of the same instance. An array is one variable, whose
   value reference is that of its first element in FMI 2.0; the one after the last is time. What an
   instance does, and what it refuses, stands in fmi2.c. */

#include "fmi2.h"

#include <stdio.h>
#include <stdlib.h>

/* --- what the standard declares (FMI 3.0.2, section 2.2) ------------------------------------------ */

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef float fmi3Float32;
typedef double fmi3Float64;
typedef int8_t fmi3Int8;
typedef int16_t fmi3Int16;
typedef int32_t fmi3Int32;
typedef int64_t fmi3Int64;
typedef uint8_t fmi3UInt8, fmi3Byte;
typedef uint16_t fmi3UInt16;
typedef uint32_t fmi3UInt32;
typedef uint64_t fmi3UInt64;
typedef bool fmi3Boolean, fmi3Clock;
typedef const char *fmi3String;
typedef const fmi3Byte *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef int fmi3IntervalQualifier, fmi3DependencyKind;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(fmi3InstanceEnvironment, fmi3Float64, fmi3Boolean,
                                               fmi3Boolean, fmi3Boolean, fmi3Boolean, fmi3Boolean *,
                                               fmi3Float64 *);

/* --- messages: FMI 2.0 has a format, of which fmi2.c uses no more than %% ------------------------- */

typedef struct {
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} fmi3_listener;

static void fmi3_hear(fmi2ComponentEnvironment to, fmi2String name, fmi2Status status,
                 fmi2String category, fmi2String format, ...)
{
    const fmi3_listener *l = to;
    char text[2048];
    size_t k = 0;
    (void)name;
    if (l->log == NULL) return;
    while (*format && k < sizeof text - 1) {
        if (format[0] == '%' && format[1] == '%') format++;
        text[k++] = *format++;
    }
    text[k] = 0;
    l->log(l->environment, (fmi3Status)status, category, text);
}

static fmi3Status fmi3_refuse(fmi3Instance p, const char *what, const char *name, const char *why)
{
    const fmi2_instance *c = p;
    char text[400];
    if (c == NULL) return fmi3Error;
    snprintf(text, sizeof text, "%s: %s%s%s: %s", c->name, what, *name ? " " : "", name, why);
    fmi3_hear(c->call.componentEnvironment, c->name, fmi2Error, "logStatusError", text);
    return fmi3Error;
}

/* --- life -------------------------------------------------------------------------------------------- */

FMI2_EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

FMI2_EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance p, fmi3Boolean on, size_t n,
                                      const fmi3String categories[])
{
    (void)on, (void)n, (void)categories;
    return p == NULL ? fmi3Error : fmi3OK;
}

FMI2_EXPORT void fmi3FreeInstance(fmi3Instance p)
{
    fmi2_instance *c = p;
    if (c == NULL) return;
    free(c->call.componentEnvironment);
    fmi2FreeInstance(c);
}

FMI2_EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
    const fmi3ValueReference intermediate[], size_t n, fmi3InstanceEnvironment environment,
    fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    fmi3_listener *l = malloc(sizeof *l);
    fmi2CallbackFunctions call = { 0 };
    fmi3Instance made;
    (void)early_return, (void)intermediate, (void)n, (void)update;
    if (l == NULL) return NULL;
    *l = (fmi3_listener){ environment, log };
    call.logger = fmi3_hear;
    call.componentEnvironment = l;
    if (event_mode) fmi3_hear(l, name, fmi2Error, "logStatusError", "there is no event mode");
    made = event_mode ? NULL : fmi2Instantiate(name, fmi2CoSimulation, token, resources, &call,
                                               visible, logging);
    if (made == NULL) free(l);
    return made;
}

FMI2_EXPORT fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token,
                                                 fmi3String resources, fmi3Boolean visible,
                                                 fmi3Boolean logging,
                                                 fmi3InstanceEnvironment environment,
                                                 fmi3LogMessageCallback log)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    if (log != NULL) log(environment, fmi3Error, "logStatusError", "it is for co-simulation only");
    return NULL;
}

FMI2_EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    void (*update)(fmi3InstanceEnvironment), void (*lock)(void), void (*unlock)(void))
{
    (void)update, (void)lock, (void)unlock;
    return fmi3InstantiateModelExchange(name, token, resources, visible, logging, environment, log);
}

FMI2_EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance p, fmi3Boolean with_tolerance,
                                              fmi3Float64 tolerance, fmi3Float64 start,
                                              fmi3Boolean with_stop, fmi3Float64 stop)
{
    const fmi2Status status =
        fmi2SetupExperiment(p, with_tolerance, tolerance, start, with_stop, stop);
    return (fmi3Status)(status == fmi2OK ? fmi2EnterInitializationMode(p) : status);
}

FMI2_EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance p)
{
    return (fmi3Status)fmi2ExitInitializationMode(p);
}

FMI2_EXPORT fmi3Status fmi3Terminate(fmi3Instance p) { return (fmi3Status)fmi2Terminate(p); }
FMI2_EXPORT fmi3Status fmi3Reset(fmi3Instance p) { return (fmi3Status)fmi2Reset(p); }

FMI2_EXPORT fmi3Status fmi3DoStep(fmi3Instance p, fmi3Float64 t, fmi3Float64 dt,
                             fmi3Boolean no_set_prior, fmi3Boolean *event, fmi3Boolean *terminate,
                             fmi3Boolean *early, fmi3Float64 *last)
{
    const fmi2_instance *c = p;
    const fmi2Status status = fmi2DoStep(p, t, dt, no_set_prior);
    if (event != NULL) *event = false;
    if (terminate != NULL) *terminate = false;
    if (early != NULL) *early = false;
    if (last != NULL && c != NULL) *last = c->now.time;
    return (fmi3Status)status;
}

/* --- values ------------------------------------------------------------------------------------------ */

/* elements of the variable, or why it has none; time has one, that is read as a Float64 */
static size_t fmi3_size_of(const fmi2_instance *c, fmi3ValueReference vr, char kind, const char **why)
{
    *why = vr >= desat_the_block.count ? "there is no such variable"
         : c->places[vr].kind != kind ? "it is of another type"
         : c->places[vr].count == 0 ? "an array is read and set as a whole, from its first element"
         : "there are too few values";
    return vr < desat_the_block.count && c->places[vr].kind == kind ? c->places[vr].count : 0;
}

static const char *fmi3_name_of(fmi3ValueReference vr, char room[40])
{
    if (vr < desat_the_block.count) return desat_the_block.variables[vr].name;
    snprintf(room, 40, "value reference %u", (unsigned)vr);
    return room;
}

/* ONE moves element `r` of the instance from or to values[k] by a call of fmi2.c */
#define FMI3_MOVE(WHAT, KIND, FIRST, ONE)                                                           \
    const fmi2_instance *c = p;                                                                     \
    size_t k = 0;                                                                                   \
    char room[40];                                                                                  \
    if (c == NULL || (n > 0 && (vr == NULL || values == NULL))) return fmi3Error;                   \
    for (size_t i = 0; i < n; i++) {                                                                \
        const char *why;                                                                            \
        size_t count;                                                                               \
        FIRST                                                                                       \
        count = fmi3_size_of(c, vr[i], KIND, &why);                                                 \
        if (count == 0 || count > m - k) return fmi3_refuse(p, WHAT, fmi3_name_of(vr[i], room), why); \
        for (fmi3ValueReference r = vr[i]; r < vr[i] + count; r++, k++) {                           \
            fmi2Status status;                                                                      \
            ONE                                                                                     \
            if (status != fmi2OK) return (fmi3Status)status;                                        \
        }                                                                                           \
    }                                                                                               \
    return k == m ? fmi3OK : fmi3_refuse(p, WHAT, "", "there are too many values");

#define FMI3_MOVES(VERB, NAME, CONST)                                                               \
    FMI2_EXPORT fmi3Status fmi3##VERB##NAME(fmi3Instance p, const fmi3ValueReference vr[], size_t n, \
                                       CONST fmi3##NAME values[], size_t m)

FMI3_MOVES(Get, Float64, )
{
    FMI3_MOVE("get Float64", 'R',
         if (vr[i] == desat_the_block.count && k < m) {
             values[k++] = c->now.time;
             continue;
         },
         status = fmi2GetReal(p, &r, 1, values + k);)
}

FMI3_MOVES(Set, Float64, const)
{
    FMI3_MOVE("set Float64", 'R', , status = fmi2SetReal(p, &r, 1, values + k);)
}

FMI3_MOVES(Get, Int64, )
{
    FMI3_MOVE("get Int64", 'I', , fmi2Integer value; status = fmi2GetInteger(p, &r, 1, &value);
         values[k] = value;)
}

FMI3_MOVES(Set, Int64, const)
{
    FMI3_MOVE("set Int64", 'I', , const fmi2Integer value = (fmi2Integer)values[k];
         if (value != values[k]) return fmi3_refuse(p, "set Int64", fmi3_name_of(r, room), "beyond 32 bits");
         status = fmi2SetInteger(p, &r, 1, &value);)
}

FMI3_MOVES(Get, Boolean, )
{
    FMI3_MOVE("get Boolean", 'B', , fmi2Boolean value; status = fmi2GetBoolean(p, &r, 1, &value);
         values[k] = value != 0;)
}

FMI3_MOVES(Set, Boolean, const)
{
    FMI3_MOVE("set Boolean", 'B', , const fmi2Boolean value = values[k];
         status = fmi2SetBoolean(p, &r, 1, &value);)
}

/* of these there is none: all right for no variables */
#define FMI3_NONE(NAME)                                                                             \
    FMI3_MOVES(Get, NAME, )                                                                         \
    {                                                                                               \
        (void)vr, (void)values, (void)m;                                                            \
        return n == 0 && p != NULL ? fmi3OK : fmi3_refuse(p, "get " #NAME, "", "there is none");    \
    }                                                                                               \
    FMI3_MOVES(Set, NAME, const)                                                                    \
    {                                                                                               \
        (void)vr, (void)values, (void)m;                                                            \
        return n == 0 && p != NULL ? fmi3OK : fmi3_refuse(p, "set " #NAME, "", "there is none");    \
    }

FMI3_NONE(Float32) FMI3_NONE(Int8) FMI3_NONE(UInt8) FMI3_NONE(Int16) FMI3_NONE(UInt16) FMI3_NONE(Int32) FMI3_NONE(UInt32) FMI3_NONE(UInt64)
FMI3_NONE(String)

FMI2_EXPORT fmi3Status fmi3GetBinary(fmi3Instance p, const fmi3ValueReference vr[], size_t n,
                                size_t sizes[], fmi3Binary values[], size_t m)
{
    (void)vr, (void)sizes, (void)values, (void)m;
    return n == 0 && p != NULL ? fmi3OK : fmi3_refuse(p, "get Binary", "", "there is none");
}

FMI2_EXPORT fmi3Status fmi3SetBinary(fmi3Instance p, const fmi3ValueReference vr[], size_t n,
                                const size_t sizes[], const fmi3Binary values[], size_t m)
{
    (void)vr, (void)sizes, (void)values, (void)m;
    return n == 0 && p != NULL ? fmi3OK : fmi3_refuse(p, "set Binary", "", "there is none");
}

FMI2_EXPORT fmi3Status fmi3GetClock(fmi3Instance p, const fmi3ValueReference vr[], size_t n,
                               fmi3Clock values[])
{
    (void)vr, (void)values;
    return n == 0 && p != NULL ? fmi3OK : fmi3_refuse(p, "get Clock", "", "there is none");
}

FMI2_EXPORT fmi3Status fmi3SetClock(fmi3Instance p, const fmi3ValueReference vr[], size_t n,
                               const fmi3Clock values[])
{
    (void)vr, (void)values;
    return n == 0 && p != NULL ? fmi3OK : fmi3_refuse(p, "set Clock", "", "there is none");
}

/* --- state ------------------------------------------------------------------------------------------- */

FMI2_EXPORT fmi3Status fmi3GetFMUState(fmi3Instance p, fmi3FMUState *state)
{
    return (fmi3Status)fmi2GetFMUstate(p, state);
}

FMI2_EXPORT fmi3Status fmi3SetFMUState(fmi3Instance p, fmi3FMUState state)
{
    return (fmi3Status)fmi2SetFMUstate(p, state);
}

FMI2_EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance p, fmi3FMUState *state)
{
    return (fmi3Status)fmi2FreeFMUstate(p, state);
}

FMI2_EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance p, fmi3FMUState state, size_t *size)
{
    return (fmi3Status)fmi2SerializedFMUstateSize(p, state, size);
}

FMI2_EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance p, fmi3FMUState state, fmi3Byte bytes[],
                                        size_t size)
{
    return (fmi3Status)fmi2SerializeFMUstate(p, state, (fmi2Byte *)bytes, size);
}

FMI2_EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance p, const fmi3Byte bytes[], size_t size,
                                          fmi3FMUState *state)
{
    return (fmi3Status)fmi2DeSerializeFMUstate(p, (const fmi2Byte *)bytes, size, state);
}

/* --- what there is not, by the modelDescription.xml too --------------------------------------------- */

#define FMI3_LACKS(NAME, WHY, PARAMETERS)                                                           \
    FMI2_EXPORT fmi3Status fmi3##NAME PARAMETERS { return fmi3_refuse(p, #NAME, "", WHY); }
#define FMI3_REFERENCES const fmi3ValueReference vr[], size_t n

#define FMI3_CLOCKS "there are no clocks"
#define FMI3_MODES "there is no such mode"
#define FMI3_DERIVATIVES "derivatives are not provided"
#define FMI3_EXCHANGE "it is for co-simulation only"

FMI3_LACKS(GetNumberOfVariableDependencies, "they stand in the modelDescription.xml", (fmi3Instance p,
      fmi3ValueReference vr, size_t *n))
FMI3_LACKS(GetVariableDependencies, "they stand in the modelDescription.xml", (fmi3Instance p,
      fmi3ValueReference vr, size_t at[], fmi3ValueReference on[], size_t on_at[],
      fmi3DependencyKind kinds[], size_t n))
FMI3_LACKS(GetDirectionalDerivative, FMI3_DERIVATIVES, (fmi3Instance p, FMI3_REFERENCES, const fmi3ValueReference
      known[], size_t m, const fmi3Float64 seed[], size_t seeds, fmi3Float64 found[], size_t finds))
FMI3_LACKS(GetAdjointDerivative, FMI3_DERIVATIVES, (fmi3Instance p, FMI3_REFERENCES, const fmi3ValueReference
      known[], size_t m, const fmi3Float64 seed[], size_t seeds, fmi3Float64 found[], size_t finds))
FMI3_LACKS(GetOutputDerivatives, FMI3_DERIVATIVES, (fmi3Instance p, FMI3_REFERENCES, const fmi3Int32 orders[],
      fmi3Float64 values[], size_t m))
FMI3_LACKS(EnterConfigurationMode, FMI3_MODES, (fmi3Instance p))
FMI3_LACKS(ExitConfigurationMode, FMI3_MODES, (fmi3Instance p))
FMI3_LACKS(EnterEventMode, FMI3_MODES, (fmi3Instance p))
FMI3_LACKS(EnterStepMode, FMI3_MODES, (fmi3Instance p))
FMI3_LACKS(EvaluateDiscreteStates, FMI3_MODES, (fmi3Instance p))
FMI3_LACKS(UpdateDiscreteStates, FMI3_MODES, (fmi3Instance p, fmi3Boolean *update, fmi3Boolean *terminate,
      fmi3Boolean *nominals, fmi3Boolean *changed, fmi3Boolean *defined, fmi3Float64 *time))
FMI3_LACKS(GetIntervalDecimal, FMI3_CLOCKS, (fmi3Instance p, FMI3_REFERENCES, fmi3Float64 intervals[],
      fmi3IntervalQualifier of[]))
FMI3_LACKS(GetIntervalFraction, FMI3_CLOCKS, (fmi3Instance p, FMI3_REFERENCES, fmi3UInt64 counters[], fmi3UInt64
      resolutions[], fmi3IntervalQualifier of[]))
FMI3_LACKS(GetShiftDecimal, FMI3_CLOCKS, (fmi3Instance p, FMI3_REFERENCES, fmi3Float64 shifts[]))
FMI3_LACKS(GetShiftFraction, FMI3_CLOCKS, (fmi3Instance p, FMI3_REFERENCES, fmi3UInt64 counters[], fmi3UInt64
      resolutions[]))
FMI3_LACKS(SetIntervalDecimal, FMI3_CLOCKS, (fmi3Instance p, FMI3_REFERENCES, const fmi3Float64 intervals[]))
FMI3_LACKS(SetIntervalFraction, FMI3_CLOCKS, (fmi3Instance p, FMI3_REFERENCES, const fmi3UInt64 counters[], const
      fmi3UInt64 resolutions[]))
FMI3_LACKS(SetShiftDecimal, FMI3_CLOCKS, (fmi3Instance p, FMI3_REFERENCES, const fmi3Float64 shifts[]))
FMI3_LACKS(SetShiftFraction, FMI3_CLOCKS, (fmi3Instance p, FMI3_REFERENCES, const fmi3UInt64 counters[], const
      fmi3UInt64 resolutions[]))
FMI3_LACKS(ActivateModelPartition, FMI3_CLOCKS, (fmi3Instance p, fmi3ValueReference clock, fmi3Float64 time))
FMI3_LACKS(EnterContinuousTimeMode, FMI3_EXCHANGE, (fmi3Instance p))
FMI3_LACKS(CompletedIntegratorStep, FMI3_EXCHANGE, (fmi3Instance p, fmi3Boolean no_set_prior, fmi3Boolean
      *event, fmi3Boolean *terminate))
FMI3_LACKS(SetTime, FMI3_EXCHANGE, (fmi3Instance p, fmi3Float64 time))
FMI3_LACKS(SetContinuousStates, FMI3_EXCHANGE, (fmi3Instance p, const fmi3Float64 states[], size_t n))
FMI3_LACKS(GetContinuousStateDerivatives, FMI3_EXCHANGE, (fmi3Instance p, fmi3Float64 derivatives[], size_t
      n))
FMI3_LACKS(GetEventIndicators, FMI3_EXCHANGE, (fmi3Instance p, fmi3Float64 indicators[], size_t n))
FMI3_LACKS(GetContinuousStates, FMI3_EXCHANGE, (fmi3Instance p, fmi3Float64 states[], size_t n))
FMI3_LACKS(GetNominalsOfContinuousStates, FMI3_EXCHANGE, (fmi3Instance p, fmi3Float64 nominals[], size_t n))
FMI3_LACKS(GetNumberOfEventIndicators, FMI3_EXCHANGE, (fmi3Instance p, size_t *n))
FMI3_LACKS(GetNumberOfContinuousStates, FMI3_EXCHANGE, (fmi3Instance p, size_t *n))
