#include "process.h"

#include "base/program.h"

#include <errno.h>
#include <gio/gio.h>
#include <glib-unix.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#define RUNNER        "mesorig-run-program"
#define RUNNER_SOCKET 3

/* Returns the environment of a program: a few variables of this process, without those of
 * systemd. */
static char **environment(void) {
    static const char *const names[] = {"PATH", "HOME", "LANG", "LC_ALL", "LC_CTYPE", "TZ", NULL};
    char **env = NULL;
    for (int i = 0; names[i]; i++)
        if (g_getenv(names[i]))
            env = g_environ_setenv(env, names[i], g_getenv(names[i]), TRUE);
    return env ? env : g_new0(char *, 1);
}

static gboolean spawn(const struct program_command *command, int socket,
                      struct program_process *process, GError **error) {
    static const int target = RUNNER_SOCKET;
    g_autofree char *runner = program_find(RUNNER, error);
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_auto(GStrv) env = environment();
    if (!runner)
        return FALSE;
    g_ptr_array_add(argv, runner);
    g_ptr_array_add(argv, command->path);
    for (char **argument = command->arguments; argument && *argument; argument++)
        g_ptr_array_add(argv, *argument);
    g_ptr_array_add(argv, NULL);
    return g_spawn_async_with_pipes_and_fds(
        NULL, (const char *const *)argv->pdata, (const char *const *)env, G_SPAWN_DO_NOT_REAP_CHILD,
        NULL, NULL, -1, -1, -1, &socket, &target, 1, &process->pid, &process->in, &process->out,
        NULL, error);
}

gboolean program_process_start(const struct program_command *command, struct program_process *ret,
                               GError **error) {
    int ends[2];
    struct program_process process = {.in = -1, .out = -1};
    /* Ignore SIGPIPE, because a write to a program that has ended must not end this process. GIO
     * does the same as soon as it has made a socket. */
    signal(SIGPIPE, SIG_IGN);
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) != 0) {
        g_set_error_literal(error, G_FILE_ERROR, g_file_error_from_errno(errno), g_strerror(errno));
        return FALSE;
    }
    const gboolean spawned = spawn(command, ends[1], &process, error);
    close(ends[1]);
    if (!spawned) {
        close(ends[0]);
        return FALSE;
    }
    process.socket = ends[0];
    g_unix_set_fd_nonblocking(process.in, TRUE, NULL);
    g_unix_set_fd_nonblocking(process.out, TRUE, NULL);
    *ret = process;
    return TRUE;
}

void program_process_close_pipes(struct program_process *process) {
    for (int i = 0; i < 2; i++) {
        int *fd = i ? &process->in : &process->out;
        if (*fd >= 0)
            close(*fd);
        *fd = -1;
    }
}

gboolean program_process_kill(const struct program_process *process) {
    return process->socket >= 0 && send(process->socket, "k", 1, MSG_NOSIGNAL) == 1;
}

char *program_process_reap(struct program_process *process) {
    int status = 0;
    pid_t pid;
    while ((pid = waitpid(process->pid, &status, 0)) < 0 && errno == EINTR)
        ;
    process->pid = 0;
    close(process->socket);
    process->socket = -1;
    if (pid < 0 || !WIFEXITED(status))
        return NULL;
    const int code = WEXITSTATUS(status);
    return code > 128
               ? g_strdup_printf("was ended by signal %d (%s)", code - 128, g_strsignal(code - 128))
               : g_strdup_printf("has ended with exit code %d", code);
}
