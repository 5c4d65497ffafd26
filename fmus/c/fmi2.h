/* What the two faces of an instance, FMI 2.0 (fmi2.c) and FMI 3.0 (fmi3.c), have in common. */
#ifndef DESAT_FMI2_H
#define DESAT_FMI2_H

#include "block.h"

#if defined(_WIN32)
#define FMI2_EXPORT __declspec(dllexport)
#else
#define FMI2_EXPORT __attribute__((visibility("default")))
#endif

/* --- what the standard declares (FMI 2.0.4, section 2.1) ------------------------------------------ */

typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef char fmi2Char, fmi2Byte;
typedef const fmi2Char *fmi2String;
typedef unsigned int fmi2ValueReference;
typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum {
    fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated
} fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;

/* --- an instance ----------------------------------------------------------------------------------- */

enum { FMI2_INSTANTIATED, FMI2_INITIALISING, FMI2_STEPPING, FMI2_TERMINATED };

/* all that a saved state has, the block's bytes after it */
typedef struct {
    double time;
    int32_t phase;
    bool stale;     /* inputs or parameters changed since the last start */
    bool unstarted; /* start has failed, and nothing else */
} fmi2_progress;

/* what get and set need of a variable, in an eighth of its bytes */
enum { FMI2_PARAMETER = 1, FMI2_OUTPUT = 2 };

typedef struct {
    uint32_t offset;
    char kind;
    char fixed; /* PARAMETER: once it steps; OUTPUT: always; 0: never */
    uint16_t count; /* elements of the array that begins here: 0 within one, 1 of a scalar */
} fmi2_place;

/* start value of a scalar, of a copy of an FMU (fmus/starts.py) */
struct fmi2_start {
    uint32_t reference;
    double value;
};

typedef struct {
    fmi2_progress now;
    void *self; /* the block */
    fmi2_place *places; /* by value reference */
    char *name; /* as given */
    char *key;  /* by which noise is keyed */
    double stop; /* no step goes beyond it; infinity where none was set */
    struct fmi2_start *starts; /* start values of a file of the resources */
    size_t start_count;
    fmi2CallbackFunctions call;
    bool reals; /* all variables are Reals (fmus/reals.py) */
} fmi2_instance;

/* what fmi3.c makes of fmi2.c */
FMI2_EXPORT void fmi2FreeInstance(fmi2Component);
FMI2_EXPORT fmi2Component fmi2Instantiate(fmi2String, fmi2Type, fmi2String, fmi2String,
                              const fmi2CallbackFunctions *, fmi2Boolean, fmi2Boolean);
FMI2_EXPORT fmi2Status fmi2SetupExperiment(fmi2Component, fmi2Boolean, fmi2Real, fmi2Real, fmi2Boolean,
                               fmi2Real);
FMI2_EXPORT fmi2Status fmi2EnterInitializationMode(fmi2Component);
FMI2_EXPORT fmi2Status fmi2ExitInitializationMode(fmi2Component);
FMI2_EXPORT fmi2Status fmi2Terminate(fmi2Component);
FMI2_EXPORT fmi2Status fmi2Reset(fmi2Component);
FMI2_EXPORT fmi2Status fmi2DoStep(fmi2Component, fmi2Real, fmi2Real, fmi2Boolean);
FMI2_EXPORT fmi2Status fmi2GetReal(fmi2Component, const fmi2ValueReference[], size_t, fmi2Real[]);
FMI2_EXPORT fmi2Status fmi2GetInteger(fmi2Component, const fmi2ValueReference[], size_t, fmi2Integer[]);
FMI2_EXPORT fmi2Status fmi2GetBoolean(fmi2Component, const fmi2ValueReference[], size_t, fmi2Boolean[]);
FMI2_EXPORT fmi2Status fmi2SetReal(fmi2Component, const fmi2ValueReference[], size_t, const fmi2Real[]);
FMI2_EXPORT fmi2Status fmi2SetInteger(fmi2Component, const fmi2ValueReference[], size_t, const fmi2Integer[]);
FMI2_EXPORT fmi2Status fmi2SetBoolean(fmi2Component, const fmi2ValueReference[], size_t, const fmi2Boolean[]);
FMI2_EXPORT fmi2Status fmi2GetFMUstate(fmi2Component, fmi2FMUstate *);
FMI2_EXPORT fmi2Status fmi2SetFMUstate(fmi2Component, fmi2FMUstate);
FMI2_EXPORT fmi2Status fmi2FreeFMUstate(fmi2Component, fmi2FMUstate *);
FMI2_EXPORT fmi2Status fmi2SerializedFMUstateSize(fmi2Component, fmi2FMUstate, size_t *);
FMI2_EXPORT fmi2Status fmi2SerializeFMUstate(fmi2Component, fmi2FMUstate, fmi2Byte[], size_t);
FMI2_EXPORT fmi2Status fmi2DeSerializeFMUstate(fmi2Component, const fmi2Byte[], size_t, fmi2FMUstate *);

#endif
