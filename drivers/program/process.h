/*
 * The process of a program that is a device. mesorig-run-program.c runs the program with few
 * rights. It kills the program and all that the program has started when this process tells it to,
 * or when this process ends. Standard error is that of this process.
 *
 * No function waits, except program_process_reap(), which is to be called when the process has
 * ended.
 */
#pragma once

#include <glib.h>
#include <sys/types.h>

/* What a section says about its program. */
struct program_command {
    char *path;
    char **arguments;
    double start_s;
};

struct program_process {
    pid_t pid;   /* process of the runner (mesorig-run-program.c); 0 if there is none */
    int in, out; /* pipes to and from the program, which do not block; −1 if closed */
    /* Socket of the runner: it can be read when the runner and all that the program has started
     * have ended. −1 if closed. */
    int socket;
};

/* Starts the program. Errors have no subject. */
gboolean program_process_start(const struct program_command *command, struct program_process *ret,
                               GError **error);

/* Closes the pipes. The program sees the end of its input. */
void program_process_close_pipes(struct program_process *process);

/* Kills the program and all that it has started. Returns FALSE if the runner has ended. */
gboolean program_process_kill(const struct program_process *process);

/* Waits for the end of the runner, and closes the socket. Returns a text that says how the program
 * has ended, such as "has ended with exit code 3", or NULL if that is not known. Free it with
 * g_free(). */
char *program_process_reap(struct program_process *process);
