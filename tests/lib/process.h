/* Programs that tests start, and their output. Errors in these functions fail the test. */
#pragma once

#include <gio/gio.h>

/* Runs argv, which ends with NULL, in a folder until it ends. Returns its exit code. If folder is
 * NULL, the current folder is used. A program that is ended by a signal fails the test. ret_out and
 * ret_err receive the output (g_free()) and may be NULL. Without ret_out, standard output is
 * discarded. */
int process_run_in(const char *folder, const char *const *argv, char **ret_out, char **ret_err);
int process_run(const char *const *argv, char **ret_out, char **ret_err);

/* Runs argv, which must end with this exit code. Returns standard output followed by standard
 * error; g_free(). */
char *process_text(int code, const char *const *argv);

/* Runs mesorig like process_text(). The arguments are separated by blanks. */
char *process_mesorig(int code, const char *format, ...) G_GNUC_PRINTF(2, 3);

/* Returns an argv of a program and arguments that end with NULL. Free it with g_free(). The strings
 * are borrowed. */
const char **process_argv(const char *program, const char *const *arguments);
const char **process_argv_valist(const char *program, va_list arguments);

/* Starts argv. The program is killed when the thread that started it ends, so that a failed test
 * leaves no program behind. log is the file for standard error, or NULL. */
GSubprocess *process_start(GSubprocessFlags flags, const char *log, const char *const *argv);

/* Does the same, and waits until the program reports via systemd's protocol (sd_notify) that it is
 * ready. */
GSubprocess *process_start_ready(GSubprocessFlags flags, const char *log, const char *const *argv);

/* Returns the processes (pid_t) that have this word among their arguments (file is "cmdline") or in
 * their environment ("environ", the word is "NAME=value"); g_array_unref(). */
GArray *process_find(const char *file, const char *word);

/* Fails and prints the text unless it contains these words. */
void assert_has(const char *text, const char *words);
