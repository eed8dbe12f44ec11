/* Long work of the command line's own process: progress, and Ctrl-C that cancels it. */
#pragma once

#include "processing/pipeline.h"

/* Calls progress(…, progress_data) as it goes; ends soon after cancellable is cancelled. */
typedef gboolean (*WorkFunc)(PipelineFunc progress, gpointer progress_data,
                             GCancellable *cancellable, gpointer data, GError **error);

/* Runs it in the calling thread, with a bar or lines of JSON. ret_seconds: how long it took. */
gboolean work_run(WorkFunc func, gpointer data, double *ret_seconds, GError **error);
