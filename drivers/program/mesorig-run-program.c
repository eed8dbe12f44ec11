/*
 * Runs a program that is a device (program.h), with few rights, and ends it in any case:
 * mesorig-run-program PROGRAM [ARGUMENT]…. Standard input and output are those of the program.
 * Descriptor 3 is a socket to the program that started this one.
 *
 * While the program does what it should, this one only waits. If it reads a byte from the socket,
 * it kills the program and all that the program has started. If the other end of the socket is
 * closed, the program first has GRACE_MS to make its device safe. The other end reads the end of
 * the socket when nothing of the program is left.
 *
 * The program is the first of a process group of its own, and this one the first of a session, so
 * that Ctrl-C in a terminal does not reach them.
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

/* A program that root starts has no capabilities, whatever it is. */
static void drop_rights(void) {
    const struct rlimit none = {0, 0};
    setrlimit(RLIMIT_CORE, &none);
    prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
    for (int i = 0; geteuid() == 0 && prctl(PR_CAPBSET_READ, i, 0, 0, 0) >= 0; i++)
        prctl(PR_CAPBSET_DROP, i, 0, 0, 0);
}

static void become(char **argv, pid_t parent) {
    setpgid(0, 0);
    /* If this one is killed, nobody is left to end the program. */
    if (prctl(PR_SET_PDEATHSIG, SIGKILL) != 0 || getppid() != parent)
        _exit(CANNOT_RUN);
    signal(SIGPIPE, SIG_DFL);
    drop_rights();
    if (chdir("/") == 0)
        execv(argv[0], argv);
    fprintf(stderr, "%s: %s\n", argv[0], strerror(errno));
    _exit(errno == ENOENT ? NOT_FOUND : CANNOT_RUN);
}

/* Waits until the program ends. Returns early, after wait_ms (-1: without a limit), if the socket
 * says something. Returns whether it is closed. */
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
        fprintf(stderr, "%s: a part of mesorigd, which starts it to run a program\n", argv[0]);
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
    setpgid(pid, pid); /* also here, because it is killed as a group */
    /* The ends of the pipes are only those of the program. */
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
