/* A program that is run for an event: its input, its time limit and its output. All functions
 * belong to the main loop's thread. */
#pragma once

#include <gio/gio.h>

/* Number of bytes of a program's output that are passed on. The rest is read and dropped. */
#define HOOKS_CHILD_MAX_OUTPUT 16384

/* Runs argv. input is written to its standard input. environ is its environment; NULL means the
 * environment of this program. Each line that it prints goes to the log. After the time limit, the
 * program and all processes that it has started are ended: by SIGTERM, and three seconds later by
 * SIGKILL. */
void hooks_child_run(const char *const *argv, const char *const *environ, const char *input,
                     double time_limit_s, GCancellable *cancellable, GAsyncReadyCallback callback,
                     gpointer data);

/* Returns the result. It is FALSE if the program could not be started, took too long, or ended with
 * an exit code that is not 0. If it was cancelled, the program is killed. The error names the
 * program. */
gboolean hooks_child_finish(GAsyncResult *result, GError **error);
