/* Programs that tests start, and what they print. What goes wrong in here fails the test. */
#pragma once

#include <gio/gio.h>

/* Runs argv, which ends with NULL, in a folder (NULL: the current one) until it ends, and returns
 * its exit code; a program that a signal ends fails the test. What it prints is returned where it
 * is asked for, g_free(); standard output is dropped otherwise. */
int process_run_in(const char *folder, const char *const *argv, char **ret_out, char **ret_err);
int process_run(const char *const *argv, char **ret_out, char **ret_err);

/* Runs argv, which must end with this exit code. Returns its standard output, followed by what it
 * wrote to standard error; g_free(). */
char *process_text(int code, const char *const *argv);

/* Runs mesorig with arguments that blanks separate, as process_text(). */
char *process_mesorig(int code, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* A program and its arguments up to NULL; g_free(), the strings belong to the caller. */
const char **process_argv(const char *program, const char *const *arguments);
const char **process_argv_valist(const char *program, va_list arguments);

/* Starts argv; it is killed when the thread ends that started it, so that a test that fails leaves
 * nothing behind. log: where standard error goes, or NULL. */
GSubprocess *process_start(GSubprocessFlags flags, const char *log, const char *const *argv);

/* The same, and waits until the program tells systemd's protocol (sd_notify) that it is ready. */
GSubprocess *process_start_ready(GSubprocessFlags flags, const char *log, const char *const *argv);

/* The processes (pid_t) that have this word among their arguments ("cmdline") or in their
 * environment ("environ", "NAME=value"); g_array_unref(). */
GArray *process_find(const char *file, const char *word);

/* Fails and shows the text unless it contains these words. */
void assert_has(const char *text, const char *words);
