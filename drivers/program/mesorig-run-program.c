/*
 * Runs a program that is a device (program.h), with few rights, and makes sure that the program
 * ends:
 *     mesorig-run-program PROGRAM [ARGUMENT]…
 * Standard input and output are those of the program. Descriptor 3 is a socket to the process that
 * started this runner.
 *
 * The runner waits until the program ends. If the runner reads a byte from the socket, it kills the
 * program and all that the program has started. If the other end of the socket is closed, the
 * program has GRACE_MS to make its device safe, and is then killed in the same way. The other end
 * of the socket reads end-of-file when the runner and everything that the program has started have
 * ended.
 *
 * The program leads its own process group, and the runner leads its own session, so that Ctrl-C in
 * a terminal reaches neither of them.
 */
#include <errno.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/pidfd.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define SOCKET   3
#define GRACE_MS 2000

/* Exit codes of this program, as in shells. */
enum { CANNOT_RUN = 126, NOT_FOUND = 127, SIGNAL = 128 };

/* Forbids core dumps and new privileges. Empties the bounding set of root, so that a program
 * that root starts has no capabilities. */
static void drop_rights(void) {
    const struct rlimit none = {0, 0};
    setrlimit(RLIMIT_CORE, &none);
    prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
    for (int i = 0; geteuid() == 0 && prctl(PR_CAPBSET_READ, i, 0, 0, 0) >= 0; i++)
        prctl(PR_CAPBSET_DROP, i, 0, 0, 0);
}

static void become(char **argv, pid_t parent) {
    setpgid(0, 0);
    /* The program dies with the runner, because nobody else would end it. */
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != parent)
        _exit(CANNOT_RUN);
    signal(SIGPIPE, SIG_DFL);
    drop_rights();
    if (chdir("/") == 0)
        execv(argv[0], argv);
    fprintf(stderr, "%s: %s\n", argv[0], strerror(errno));
    _exit(errno == ENOENT ? NOT_FOUND : CANNOT_RUN);
}

/* Waits until the program ends, the socket has a byte or is closed, or wait_ms are over (-1: no
 * limit). Returns 1 if the socket is closed and the program has not ended, otherwise 0. A socket of
 * -1 is ignored. */
static int await(int program, int socket, int wait_ms) {
    struct pollfd ready[] = {{program, POLLIN, 0}, {socket, POLLIN, 0}};
    char byte;
    while (poll(ready, 2, wait_ms) < 0 && errno == EINTR)
        ;
    return socket >= 0 && ready[1].revents && !ready[0].revents && read(socket, &byte, 1) == 0;
}

int main(int argc, char **argv) {
    const pid_t own = getpid();
    int status = 0;
    if (argc < 2 || setsid() < 0) {
        fprintf(stderr,
                "%s: only mesorigd starts this program, to run a program that is a device\n",
                argv[0]);
        return CANNOT_RUN;
    }
    close_range(SOCKET + 1, ~0U, 0);
    close_range(SOCKET, SOCKET, CLOSE_RANGE_CLOEXEC);
    const pid_t pid = fork();
    if (pid == 0)
        become(argv + 1, own);
    if (pid < 0) {
        fprintf(stderr, "%s: %s\n", argv[1], strerror(errno));
        return CANNOT_RUN;
    }
    setpgid(pid, pid); /* also here, because the group must exist before kill(-pid) */
    /* Only the program keeps these ends of the pipes. */
    close(STDIN_FILENO);
    close(STDOUT_FILENO);
    const int program = pidfd_open(pid, 0);
    if (await(program, SOCKET, -1))
        await(program, -1, GRACE_MS);
    kill(-pid, SIGKILL);
    kill(pid, SIGKILL);
    while (waitpid(pid, &status, 0) < 0 && errno == EINTR)
        ;
    return WIFSIGNALED(status) ? SIGNAL + WTERMSIG(status) : WEXITSTATUS(status);
}
