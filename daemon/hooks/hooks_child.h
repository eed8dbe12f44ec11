/* A program that is run for an event: what it reads, how long it may take, and what it prints. Main
 * loop's thread. */
#pragma once

#include <gio/gio.h>

/* Bytes of a program's output that are passed on; the rest is read and dropped. */
#define HOOKS_CHILD_MOST_OUTPUT 16384

/* Runs argv with input at its standard input, and environ (NULL: this program's). What it prints
 * goes to the log, a line each. After the time limit it and all that it has started are ended:
 * SIGTERM, and SIGKILL three seconds later. */
void hooks_child_run(const char *const *argv, const char *const *environ, const char *input,
                     double time_limit_s, GCancellable *cancellable, GAsyncReadyCallback callback,
                     gpointer data);

/* FALSE: it could not be started, took too long, or ended with an exit code that is not 0;
 * cancelled, it is killed. The error names the program. */
gboolean hooks_child_finish(GAsyncResult *result, GError **error);
