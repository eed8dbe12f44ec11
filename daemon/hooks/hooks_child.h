/* Runs a program for an event, with an input and a time limit, and writes its output to the log.
 * All functions belong to the main loop's thread. */
#pragma once

#include <gio/gio.h>

/* Maximum number of bytes of a program's output that are written to the log. The rest is read and
 * dropped. */
#define HOOKS_CHILD_MAX_OUTPUT 16384

/* Runs argv. input is written to its standard input. environ is its environment; NULL means the
 * environment of this program. Each line that the program prints is written to the log. After
 * the time limit, the program and all processes of its process group get SIGTERM, and three
 * seconds later SIGKILL. If cancellable is cancelled, they get SIGKILL at once. When the program
 * has ended, the other processes of its group get SIGKILL. */
void hooks_child_run(const char *const *argv, const char *const *environ, const char *input,
                     double time_limit_s, GCancellable *cancellable, GAsyncReadyCallback callback,
                     gpointer data);

/* Returns TRUE if the program has ended with exit code 0. Returns FALSE with an error if it could
 * not be started, took too long, was cancelled, or ended by a signal or with another exit code. */
gboolean hooks_child_finish(GAsyncResult *result, GError **error);
