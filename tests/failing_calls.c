/* Lets one call of the system fail, or all from it on, among those on files below a directory. The library is
 * preloaded; the environment says which: FAIL_UNDER (the directory), FAIL_AT (number of the call, from 1; 0: none),
 * FAIL_AS (errno), FAIL_ON (set: all later calls fail, too), FAIL_COUNT (a file that gets their number). */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/uio.h>
#include <unistd.h>

static atomic_long calls;
static long at, as;
static int on;
static const char *under;

__attribute__((constructor)) static void begin(void) {
    const char *number = getenv("FAIL_AT"), *error = getenv("FAIL_AS");
    at = number ? atol(number) : 0;
    as = error ? atol(error) : EIO;
    on = getenv("FAIL_ON") != NULL;
    under = getenv("FAIL_UNDER");
}

__attribute__((destructor)) static void end(void) {
    const char *path = getenv("FAIL_COUNT");
    FILE *file = path ? fopen(path, "w") : NULL;
    if (!file) return;
    fprintf(file, "%ld\n", (long)calls);
    fclose(file);
}

/* Whether this call on a file below the directory fails. */
static int fails(const char *path) {
    char absolute[2 * PATH_MAX];
    if (!under || !path) return 0;
    if (path[0] != '/') {
        if (!getcwd(absolute, PATH_MAX)) return 0;
        strcat(absolute, "/");
        strncat(absolute, path, PATH_MAX - 1);
        path = absolute;
    }
    if (strncmp(path, under, strlen(under))) return 0;
    long nth = atomic_fetch_add(&calls, 1) + 1;
    if (!at || !(on ? nth >= at : nth == at)) return 0;
    errno = as;
    return 1;
}

static int fails_on(int fd) {
    char link[64], path[PATH_MAX];
    snprintf(link, sizeof link, "/proc/self/fd/%d", fd);
    ssize_t length = readlink(link, path, sizeof path - 1);
    if (length <= 0 || path[0] != '/') return 0; /* a pipe */
    path[length] = 0;
    return fails(path);
}

#define REAL(name) ((__typeof__(name) *)dlsym(RTLD_NEXT, #name))
#define WRAP(type, name, parameters, failing, arguments) \
    type name parameters { return (failing) ? -1 : REAL(name) arguments; }

WRAP(ssize_t, read, (int fd, void *to, size_t n), fails_on(fd), (fd, to, n))
WRAP(ssize_t, pread64, (int fd, void *to, size_t n, off64_t from), fails_on(fd), (fd, to, n, from))
WRAP(ssize_t, write, (int fd, const void *of, size_t n), fails_on(fd), (fd, of, n))
WRAP(ssize_t, writev, (int fd, const struct iovec *of, int n), fails_on(fd), (fd, of, n))
WRAP(ssize_t, pwrite64, (int fd, const void *of, size_t n, off64_t to), fails_on(fd), (fd, of, n, to))
WRAP(int, fsync, (int fd), fails_on(fd), (fd))
WRAP(int, fdatasync, (int fd), fails_on(fd), (fd))
WRAP(int, ftruncate64, (int fd, off64_t n), fails_on(fd), (fd, n))
WRAP(int, rename, (const char *from, const char *to), fails(to), (from, to))
WRAP(int, unlink, (const char *path), fails(path), (path))
WRAP(int, mkdir, (const char *path, mode_t mode), fails(path), (path, mode))

int open64(const char *path, int flags, ...) {
    va_list rest;
    va_start(rest, flags);
    mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;
    va_end(rest);
    return fails(path) ? -1 : REAL(open64)(path, flags, mode);
}
