/* A disk that is full, without mounting one: of what lies below FULL_BELOW no more than FULL_AFTER
 * bytes are new, of all processes that count in the file FULL_USED; then FULL_ERRNO. To be
 * preloaded. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static const char *below;
static long *used, most;
static int number;

__attribute__((constructor)) static void begin(void)
{
    int file = open(getenv("FULL_USED"), O_RDWR | O_CREAT, 0600);
    if (file < 0 || ftruncate(file, sizeof *used)) abort();
    used = mmap(0, sizeof *used, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    most = atol(getenv("FULL_AFTER"));
    number = atoi(getenv("FULL_ERRNO"));
    below = getenv("FULL_BELOW");
}

/* How many of n bytes there is room for, from `at` on, or where the file is (-1). */
static long room(int file, long at, long n)
{
    char link[64], path[4096];
    struct stat state;
    snprintf(link, sizeof link, "/proc/self/fd/%d", file);
    ssize_t length = below && n ? readlink(link, path, sizeof path - 1) : -1;
    if (length < 0) return n;
    path[length] = 0;
    if (strncmp(path, below, strlen(below)) || fstat(file, &state) || !S_ISREG(state.st_mode))
        return n;
    if (at < 0)
        at = fcntl(file, F_GETFL) & O_APPEND ? state.st_size : lseek(file, 0, SEEK_CUR);
    long more = at + n - (state.st_size > at ? state.st_size : at);
    if (more <= 0) return n;
    long lacks = __sync_add_and_fetch(used, more) - most;
    if (lacks <= 0) return n;
    lacks = lacks < more ? lacks : more;
    __sync_fetch_and_sub(used, lacks);
    return n - lacks;
}

#define LIMITED(name, at, ...)                                                                       \
    static __typeof__(name) *real;                                                                   \
    long fits = room(file, at, n);                                                                   \
    if (!real) real = dlsym(RTLD_NEXT, #name);                                                       \
    if (n && fits <= 0) return errno = number, -1;                                                   \
    n = fits;                                                                                        \
    return real(file, from, n __VA_ARGS__);
#define AND(x) , x

ssize_t write(int file, const void *from, size_t n) { LIMITED(write, -1, ) }
ssize_t pwrite(int file, const void *from, size_t n, off_t at) { LIMITED(pwrite, at, AND(at)) }
ssize_t pwrite64(int file, const void *from, size_t n, off_t at) { LIMITED(pwrite64, at, AND(at)) }
