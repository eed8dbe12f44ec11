#include "picture_child.h"

#include "base/input_file.h"
#include "base/new_file.h"
#include "vision.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

struct picture_child {
    int result, told; /* descriptors: a file in memory, a pipe */
};

struct told {
    int done, n;
};

/* A child that fails writes this into the file instead of a result. */
struct child_error {
    gboolean is_input; /* INPUT_FILE_ERROR, otherwise VISION_ERROR */
    int code;
};

gboolean picture_child_write(struct picture_child *child, gconstpointer bytes, gsize n) {
    return new_file_write(child->result, bytes, n);
}

void picture_child_tell(struct picture_child *child, int done, int n) {
    const struct told told = {done, n};
    while (write(child->told, &told, sizeof told) < 0 && errno == EINTR)
        ;
}

static void picture_child_main(struct picture_child *child, int cpu_s, PictureChildFunc func,
                               gpointer data) {
    static const int ends[] = {SIGINT, SIGTERM, SIGHUP};
    const struct rlimit limit = {(rlim_t)cpu_s, (rlim_t)cpu_s}, none = {0, 0};
    GError *error = NULL;

    /* Users cannot use what libraries print of a damaged file. */
    const int nowhere = open("/dev/null", O_WRONLY | O_CLOEXEC);
    if (nowhere >= 0)
        dup2(nowhere, STDERR_FILENO);
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    for (gsize i = 0; i < G_N_ELEMENTS(ends); i++)
        signal(ends[i], SIG_DFL);
    setrlimit(RLIMIT_CPU, &limit);
    setrlimit(RLIMIT_CORE, &none);
    if (func(child, data, &error))
        _exit(0);
    const struct child_error head = {error && error->domain == INPUT_FILE_ERROR,
                                     error ? error->code : VISION_ERROR_FAILED};
    const char *message = error ? error->message : "what was read cannot be kept in memory";
    if (ftruncate(child->result, 0) == 0 && lseek(child->result, 0, SEEK_SET) == 0 &&
        picture_child_write(child, &head, sizeof head))
        picture_child_write(child, message, strlen(message) + 1);
    _exit(1);
}

/* Until the child closes the pipe; FALSE: told has ended it. */
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

static GBytes *picture_child_result(const char *path, const char *reader, int status, int fd,
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
            g_set_error_literal(error, head.is_input ? INPUT_FILE_ERROR : VISION_ERROR, head.code,
                                (const char *)g_bytes_get_data(result, NULL) + at);
            return NULL;
        }
    }
    g_set_error(error, VISION_ERROR, VISION_ERROR_IO,
                "%s: %s has crashed on it (%s): it is damaged", path, reader,
                WIFSIGNALED(status) ? g_strsignal(WTERMSIG(status)) : "without a result");
    return NULL;
}

GBytes *picture_child_run(const char *path, const char *reader, int cpu_s, PictureChildFunc func,
                          gpointer data, PictureChildTold told, gpointer told_data,
                          GError **error) {
    int ends[2] = {-1, -1}, status = 0;
    GBytes *result = NULL;
    struct picture_child child = {memfd_create("mesorig-picture", MFD_CLOEXEC), -1};
    pid_t pid = -1;
    if (child.result >= 0 && pipe2(ends, O_CLOEXEC) == 0)
        pid = fork();
    if (pid == 0) {
        child.told = ends[1];
        close(ends[0]);
        picture_child_main(&child, cpu_s, func, data);
    }
    if (pid < 0) {
        g_set_error(error, VISION_ERROR, VISION_ERROR_FAILED,
                    "%s: no process can be started to read it: %s", path, g_strerror(errno));
    } else {
        close(ends[1]);
        ends[1] = -1;
        const gboolean ended = picture_child_listen(ends[0], told, told_data, error);
        if (!ended)
            kill(pid, SIGKILL);
        while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
            ;
        if (ended)
            result = picture_child_result(path, reader, status, child.result, error);
    }
    for (int i = 0; i < 2; i++)
        if (ends[i] >= 0)
            close(ends[i]);
    if (child.result >= 0)
        close(child.result);
    return result;
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
