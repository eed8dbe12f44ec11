/* Long work of the command line's own process: progress, and Ctrl-C that cancels it. */
#pragma once

#include "processing/pipeline.h"

/* Calls progress(…, progress_data) as it goes; ends soon after cancellable is cancelled. */
typedef gboolean (*WorkFunc)(PipelineFunc progress, gpointer progress_data,
                             GCancellable *cancellable, gpointer data, GError **error);

/* What a WorkFunc was given, and since when it works. */
struct work_stage {
    PipelineFunc progress;
    gpointer data;
    GCancellable *cancellable;
    gint64 begun_us;
};
struct work_stage work_stage(PipelineFunc progress, gpointer data, GCancellable *cancellable);

/* Tells how far it is, and from a twentieth on how long the rest may take. FALSE: it was cancelled.
 */
gboolean work_tell(const struct work_stage *stage, const char *name, int done, int total);

/* Runs it in the calling thread, with a bar or lines of JSON. ret_seconds: how long it took. */
gboolean work_run(WorkFunc func, gpointer data, double *ret_seconds, GError **error);
