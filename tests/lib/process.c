#include "process.h"
#include "lib/ok.h"

#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#define READY_MS 60000

int process_run_in(const char *folder, const char *const *argv, char **ret_out, char **ret_err) {
    const GSpawnFlags flags =
        G_SPAWN_SEARCH_PATH | (ret_out ? G_SPAWN_DEFAULT : G_SPAWN_STDOUT_TO_DEV_NULL);
    int status = -1;
    ok(g_spawn_sync(folder, (char **)argv, NULL, flags, NULL, NULL, ret_out, ret_err, &status,
                    ERR));
    if (!WIFEXITED(status))
        g_error("%s %s: ended with wait status 0x%x: %s", argv[0], argv[1] ? argv[1] : "",
                (unsigned)status, ret_err ? *ret_err : "");
    return WEXITSTATUS(status);
}

int process_run(const char *const *argv, char **ret_out, char **ret_err) {
    return process_run_in(NULL, argv, ret_out, ret_err);
}

char *process_text(int code, const char *const *argv) {
    g_autofree char *out = NULL, *err = NULL, *line = g_strjoinv(" ", (char **)argv);
    const int is = process_run(argv, &out, &err);
    if (is != code)
        g_error("%s: exit code %d, not %d\n%s%s", line, is, code, out, err);
    return g_strconcat(out, err, NULL);
}

const char **process_argv(const char *program, const char *const *arguments) {
    GPtrArray *argv = g_ptr_array_new();
    g_ptr_array_add(argv, (gpointer)program);
    for (; *arguments; arguments++)
        g_ptr_array_add(argv, (gpointer)*arguments);
    g_ptr_array_add(argv, NULL);
    return (const char **)g_ptr_array_free(argv, FALSE);
}

const char **process_argv_valist(const char *program, va_list arguments) {
    GPtrArray *argv = g_ptr_array_new();
    g_ptr_array_add(argv, (gpointer)program);
    for (char *argument; (argument = va_arg(arguments, char *));)
        g_ptr_array_add(argv, argument);
    g_ptr_array_add(argv, NULL);
    return (const char **)g_ptr_array_free(argv, FALSE);
}

static void die_with_parent(gpointer unused) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
}

static GSubprocess *start(GSubprocessLauncher *launcher, const char *log, const char *const *argv) {
    if (log)
        g_subprocess_launcher_set_stderr_file_path(launcher, log);
    g_subprocess_launcher_set_child_setup(launcher, die_with_parent, NULL, NULL);
    GSubprocess *process = ok(g_subprocess_launcher_spawnv(launcher, argv, ERR));
    return process;
}

GSubprocess *process_start(GSubprocessFlags flags, const char *log, const char *const *argv) {
    g_autoptr(GSubprocessLauncher) launcher = g_subprocess_launcher_new(flags);
    return start(launcher, log, argv);
}

GSubprocess *process_start_ready(GSubprocessFlags flags, const char *log, const char *const *argv) {
    g_autoptr(GSubprocessLauncher) launcher = g_subprocess_launcher_new(flags);
    struct sockaddr_un at = {.sun_family = AF_UNIX};
    socklen_t size = sizeof(at.sun_family); /* the kernel chooses an abstract name */
    struct pollfd notified = {socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0), POLLIN, 0};
    g_assert_cmpint(bind(notified.fd, (struct sockaddr *)&at, size), ==, 0);
    size = sizeof(at);
    g_assert_cmpint(getsockname(notified.fd, (struct sockaddr *)&at, &size), ==, 0);
    g_autofree char *name =
        g_strndup(at.sun_path + 1, size - offsetof(struct sockaddr_un, sun_path) - 1);
    g_autofree char *address = g_strconcat("@", name, NULL);
    g_subprocess_launcher_setenv(launcher, "NOTIFY_SOCKET", address, TRUE);
    GSubprocess *process = start(launcher, log, argv);
    char told[4096] = "";
    while (!strstr(told, "READY=1")) {
        if (poll(&notified, 1, READY_MS) <= 0)
            g_error("%s has not said within %d s that it is ready", argv[0], READY_MS / 1000);
        const ssize_t n = recv(notified.fd, told, sizeof(told) - 1, 0);
        told[MAX(n, 0)] = '\0';
    }
    close(notified.fd);
    return process;
}

GArray *process_find(const char *file, const char *word) {
    GArray *pids = g_array_new(FALSE, FALSE, sizeof(pid_t));
    g_autoptr(GDir) proc = g_dir_open("/proc", 0, NULL);
    for (const char *name; (name = g_dir_read_name(proc));) {
        const pid_t pid = (pid_t)g_ascii_strtoll(name, NULL, 10);
        g_autofree char *path = g_build_filename("/proc", name, file, NULL);
        g_autofree char *text = NULL;
        gsize length = 0;
        if (pid == 0 || !g_file_get_contents(path, &text, &length, NULL))
            continue;
        const char *at = text;
        while (at < text + length && strcmp(at, word) != 0)
            at += strlen(at) + 1;
        if (at < text + length)
            g_array_append_val(pids, pid);
    }
    return pids;
}

void assert_has(const char *text, const char *words) {
    if (!text || !strstr(text, words))
        g_error("no “%s” in: %s", words, text);
}

char *process_mesorig(int code, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *line = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_auto(GStrv) words = g_strsplit(line, " ", -1);
    g_autofree const char **argv =
        process_argv(BUILD_DIR "/bin/mesorig", (const char *const *)words);
    return process_text(code, argv);
}
