#include "picture_child.h"

#include "base/input_file.h"
#include "base/new_file.h"
#include "base/program.h"
#include "vision.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

/* The file descriptors of the program are the file, a file in memory for the result, and a pipe for
 * the progress. */
enum { CHILD_FILE = 3, CHILD_RESULT, CHILD_TOLD };

struct told {
    int done, n;
};

/* A child that fails writes this, and then the text of the error, into the file in memory instead
 * of a result. */
struct child_error {
    gboolean is_input; /* TRUE: the code is an INPUT_FILE_ERROR; FALSE: a PICTURE_FILE_ERROR */
    int code;
};

gboolean picture_child_write(gconstpointer bytes, gsize n) {
    return new_file_write(CHILD_RESULT, bytes, n);
}

void picture_child_tell(int done, int n) {
    const struct told told = {done, n};
    while (write(CHILD_TOLD, &told, sizeof told) < 0 && errno == EINTR)
        ;
}

G_NORETURN static void picture_child_end(const GError *error) {
    const struct child_error head = {error->domain == INPUT_FILE_ERROR, error->code};
    if (ftruncate(CHILD_RESULT, 0) == 0 && lseek(CHILD_RESULT, 0, SEEK_SET) == 0 &&
        picture_child_write(&head, sizeof head))
        picture_child_write(error->message, strlen(error->message) + 1);
    _exit(1);
}

void picture_child_main(int argc, char **argv, int cpu_s, PictureChildFunc func) {
    const struct rlimit limit = {(rlim_t)cpu_s, (rlim_t)cpu_s}, none = {0, 0};
    GError *error = NULL;
    struct stat file;
    if (argc != 3 || fstat(CHILD_FILE, &file) != 0 || fcntl(CHILD_RESULT, F_GETFD) < 0 ||
        fcntl(CHILD_TOLD, F_GETFD) < 0) {
        fprintf(stderr, "%s: this program is a part of mesorig, and only mesorig can start it\n",
                argv[0]);
        _exit(2);
    }
    const struct picture_job job = {argv[0], argv[1], CHILD_FILE, (guint64)file.st_size,
                                    atoi(argv[2])};
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    setrlimit(RLIMIT_CPU, &limit);
    setrlimit(RLIMIT_CORE, &none);
    if (func(&job, &error))
        _exit(0);
    if (!error) /* picture_child_write() has failed */
        g_set_error(
            &error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
            "%s: there is too little memory for what was read; close other programs and try again",
            job.path);
    picture_child_end(error);
}

/* Reads messages until the child closes the pipe. Returns FALSE with an error if told returns
 * FALSE. */
static gboolean picture_child_listen(int fd, PictureChildTold told, gpointer data, GError **error) {
    struct told message;
    for (;;) {
        const ssize_t n = read(fd, &message, sizeof message);
        if (n < 0 && errno == EINTR)
            continue;
        if (n != sizeof message)
            return TRUE;
        if (told && !told(message.done, message.n, data, error))
            return FALSE;
    }
}

static GBytes *picture_child_result(const char *path, const char *library, int status, int fd,
                                    GError **error) {
    const off_t length = lseek(fd, 0, SEEK_END);
    gsize at = 0;
    struct child_error head;
    g_autofree char *bytes = length > 0 ? g_try_malloc((gsize)length + 1) : NULL;
    for (gsize done = 0; bytes && done < (gsize)length;) {
        const ssize_t n = pread(fd, bytes + done, (gsize)length - done, (off_t)done);
        if (n <= 0)
            g_clear_pointer(&bytes, g_free);
        done += (gsize)MAX(n, 0);
    }
    if (bytes) {
        bytes[length] = '\0';
        g_autoptr(GBytes) result = g_bytes_new_take(g_steal_pointer(&bytes), (gsize)length);
        if (WIFEXITED(status) && WEXITSTATUS(status) == 0)
            return g_steal_pointer(&result);
        if (WIFEXITED(status) && picture_child_take(result, &at, &head, sizeof head)) {
            g_set_error_literal(error, head.is_input ? INPUT_FILE_ERROR : PICTURE_FILE_ERROR,
                                head.code, (const char *)g_bytes_get_data(result, NULL) + at);
            return NULL;
        }
    }
    if (WIFSIGNALED(status))
        g_set_error(
            error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
            "%s: %s has crashed on this file (%s); the file is probably damaged, so copy it again",
            path, library, g_strsignal(WTERMSIG(status)));
    else
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO,
                    "%s: %s has ended without a result; copy the file again if it is damaged, or "
                    "close other programs if there is too little memory",
                    path, library);
    return NULL;
}

/* Starts the program with its three descriptors. Returns its process id, or −1 on error. */
static pid_t start(const struct picture_job *job, int result, int told, GError **error) {
    static const int targets[] = {CHILD_FILE, CHILD_RESULT, CHILD_TOLD};
    const int sources[] = {job->fd, result, told};
    g_autofree char *program = program_find(job->program, error);
    g_autofree char *most = g_strdup_printf("%d", job->most);
    const char *const argv[] = {program, job->path, most, NULL};
    pid_t pid = -1;
    if (program)
        g_spawn_async_with_pipes_and_fds(NULL, argv, NULL,
                                         G_SPAWN_DO_NOT_REAP_CHILD | G_SPAWN_STDOUT_TO_DEV_NULL |
                                             G_SPAWN_STDERR_TO_DEV_NULL,
                                         NULL, NULL, -1, -1, -1, sources, targets,
                                         G_N_ELEMENTS(targets), &pid, NULL, NULL, NULL, error);
    return pid > 0 ? pid : -1;
}

/* Waits until the program ends, or kills it if told returns FALSE. Returns the program's result, or
 * NULL with an error. */
static GBytes *hear(const struct picture_job *job, const char *library, pid_t pid, int told_fd,
                    int result, PictureChildTold told, gpointer data, GError **error) {
    int status = 0;
    const gboolean ended = picture_child_listen(told_fd, told, data, error);
    if (!ended)
        kill(pid, SIGKILL);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        ;
    return ended ? picture_child_result(job->path, library, status, result, error) : NULL;
}

GBytes *picture_child_run(const struct picture_job *job, const char *library, PictureChildTold told,
                          gpointer told_data, GError **error) {
    int ends[2] = {-1, -1};
    GBytes *ret = NULL;
    const int result = memfd_create("mesorig-picture", MFD_CLOEXEC);
    if (result < 0 || pipe2(ends, O_CLOEXEC) != 0) {
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
                    "%s: the program that reads this file cannot be started: %s; close other "
                    "programs and try again",
                    job->path, g_strerror(errno));
    } else {
        const pid_t pid = start(job, result, ends[1], error);
        close(ends[1]);
        if (pid > 0)
            ret = hear(job, library, pid, ends[0], result, told, told_data, error);
        close(ends[0]);
    }
    if (result >= 0)
        close(result);
    return ret;
}

gboolean picture_child_take(GBytes *from, gsize *at, gpointer to, gsize n) {
    gsize length;
    const char *bytes = g_bytes_get_data(from, &length);
    if (n > length - *at)
        return FALSE;
    if (n > 0)
        memcpy(to, bytes + *at, n);
    *at += n;
    return TRUE;
}
