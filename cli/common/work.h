/* Long work in the process of the command line, with progress. SIGINT (Ctrl-C), SIGTERM and SIGHUP
 * cancel the work. */
#pragma once

#include "base/output_file.h"
#include "base/work.h"

typedef gboolean (*CliWork)(const struct work *work, gpointer data, GError **error);

/* Runs func in the calling thread and shows a bar. With --json, there is no bar; a command with
 * `streams` (cli.h) prints lines of JSON instead. Returns what func returns. ret_seconds, which may
 * be NULL, is set to the real time that func took, even if func failed. */
gboolean cli_work_run(CliWork func, gpointer data, double *ret_seconds, GError **error);

typedef gboolean (*CliWrite)(const char *path, const struct work *work, gpointer data,
                             GError **error);

/* The same as cli_work_run(), for work that writes one output file. func writes to `path`, the path
 * of a temporary file (output_file_path()). output_file_end() then moves this file to its place. */
gboolean cli_work_write(OutputFile *to, CliWrite func, gpointer data, double *ret_seconds,
                        GError **error);
