/* Long work in the process of the command line, with progress. SIGINT (Ctrl-C), SIGTERM and SIGHUP
 * cancel the work. */
#pragma once

#include "base/output_file.h"
#include "base/work.h"

typedef gboolean (*CliWork)(const struct work *work, gpointer data, GError **error);

/* Runs func in the calling thread, and shows a bar. With --json, a command with `streams` (cli.h)
 * prints lines of JSON instead, and others show nothing. Returns what func returns. ret_seconds
 * (may be NULL) is the real time that func took, also if it failed. */
gboolean cli_work_run(CliWork func, gpointer data, double *ret_seconds, GError **error);

typedef gboolean (*CliWrite)(const char *path, const struct work *work, gpointer data,
                             GError **error);

/* The same as cli_work_run() for work that writes one output file. func writes to path, which is
 * output_file_path(). The file is then delivered with output_file_end(). */
gboolean cli_work_write(OutputFile *to, CliWrite func, gpointer data, double *ret_seconds,
                        GError **error);
