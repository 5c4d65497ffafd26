/* A plain C host: loads FMI 2.0 FMUs, steps, saves, restores and frees them. LIBRARY GUID ... */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>

typedef void *C;
typedef struct { void *log, *get, *free, *end, *environment; } Calls;
#define CALL(name, ...) ((int (*)())dlsym(library, "fmi2" #name))(__VA_ARGS__)
#define OK(name, ...) if (CALL(name, __VA_ARGS__) != 0) return printf("%s: " #name "\n", path), 1

static int tried(const char *path, const char *guid)
{
    void *library = dlopen(path, RTLD_NOW), *state = NULL;
    Calls calls = {0};
    C c;
    unsigned fault = 0;
    int faulty = 1;
    if (library == NULL) return printf("%s\n", dlerror()), 1;
    C (*make)(const char *, int, const char *, const char *, Calls *, int, int) =
        (C (*)(const char *, int, const char *, const char *, Calls *, int, int))dlsym(library, "fmi2Instantiate");
    if ((c = make("host", 1, guid, "", &calls, 0, 0)) == NULL) return printf("%s: none\n", path), 1;
    OK(SetupExperiment, c, 0, 0.0, 0.0, 0, 0.0);
    OK(EnterInitializationMode, c);
    OK(ExitInitializationMode, c);
    for (int k = 0; k < 10; k++) OK(DoStep, c, (double)k, 1.0, 1);
    OK(GetFMUstate, c, &state);
    for (int k = 10; k < 20; k++) OK(DoStep, c, (double)k, 1.0, 1);
    OK(SetFMUstate, c, state);
    for (int k = 10; k < 20; k++) OK(DoStep, c, (double)k, 1.0, 1);
    OK(FreeFMUstate, c, &state);
    OK(GetBoolean, c, &fault, (size_t)1, &faulty);
    OK(Terminate, c);
    ((void (*)(C))dlsym(library, "fmi2FreeInstance"))(c);
    return faulty;
}

int main(int n, char **given)
{
    for (int k = 1; k + 1 < n; k += 2)
        if (tried(given[k], given[k + 1]) != 0) return 1;
    printf("%d FMUs\n", (n - 1) / 2);
    return 0;
}
