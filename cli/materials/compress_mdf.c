/* compress --method=mdf: the distances of a session in fewer bytes. */
#include "common/work.h"
#include "compress.h"
#include "plan/report.h"
#include "session/session.h"

#include <glib/gstdio.h>

struct job {
    const struct compress_asked *asked;
    char *from;
    OutputFile *to;
    /* found */
    struct mdf_codec_result result;
    char *what;
    int width, height, n_measured;
    gint64 file_bytes;
    double texel_mm;
};

static gboolean cli_compress_mdf_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    const struct compress_asked *asked = job->asked;
    struct mdf_table *table =
        session_check_product(job->from, error) ? mdf_table_read(job->from, error) : NULL;
    const char *to = table ? output_file_path(job->to, error) : NULL;
    if (!to) {
        mdf_table_free(table);
        return FALSE;
    }
    const struct mdf_codec_job encode = {.from = job->from,
                                         .to = to,
                                         .table = table,
                                         .n_measured = table->n_views,
                                         .options = asked->options,
                                         .work = work};
    job->width = table->width;
    job->height = table->height;
    job->n_measured = table->n_views;
    job->texel_mm = table->texel_mm;
    const gboolean encoded = asked->method.mdf->encode(&encode, &job->result, error);
    GStatBuf status;
    if (encoded && g_stat(to, &status) == 0)
        job->file_bytes = status.st_size;
    const gboolean ok = output_file_end(job->to, encoded, error) &&
                        session_add_product_file(asked->output, asked->made_by, error);
    if (ok)
        job->what = asked->method.mdf->describe(&encode, &job->result);
    mdf_table_free(table);
    return ok;
}

static void cli_compress_mdf_tell(Record *to, const struct job *job, double seconds) {
    const struct mdf_codec_result *result = &job->result;
    /* One byte a texel and view, as published. */
    const gint64 raw_bytes = (gint64)job->n_measured * job->width * job->height;
    g_autofree char *time = report_duration(seconds);
    g_autofree char *size = g_format_size((guint64)result->bytes);
    g_autofree char *file = g_format_size((guint64)job->file_bytes);
    record_string(to, "file", job->asked->output);
    record_string(to, "method", job->asked->method.name);
    record_int(to, "width", job->width);
    record_int(to, "height", job->height);
    record_int(to, "views", job->n_measured);
    record_int(to, "traced_views", result->n_traced);
    record_int(to, "maps", result->n_terms);
    record_int(to, "mdf_bytes", raw_bytes);
    record_int(to, "bytes", result->bytes);
    record_int(to, "file_bytes", job->file_bytes);
    record_double(to, "error_mm", result->error_mm);
    record_double(to, "error_99_mm", result->max_mm);
    record_double(to, "texel_mm", job->texel_mm);
    record_double(to, "real_s", seconds);
    record_say(to,
               "%s: done in %s: %s; error %.3f mm RMS (%.3f texels), below %.3f mm for 99 %%; "
               "%s, 1:%.1f of the views in 8 bit; %s on disk\n",
               job->asked->output, time, job->what, result->error_mm,
               result->error_mm / job->texel_mm, result->max_mm, size,
               (double)raw_bytes / (double)result->bytes, file);
    cli_tell_output(to, job->to);
}

int compress_mdf(const struct compress_asked *asked, Record *to, GError **error) {
    struct job job = {.asked = asked};
    double seconds = 0;
    job.from = g_file_test(asked->path, G_FILE_TEST_IS_DIR)
                   ? g_build_filename(asked->path, "products", "mdf.exr", NULL)
                   : g_strdup(asked->path);
    job.to = cli_output_locked(asked->output, asked->method.mdf->kind, error);
    const gboolean ok = job.to && cli_work_run(cli_compress_mdf_work, &job, &seconds, error);
    if (ok)
        cli_compress_mdf_tell(to, &job, seconds);
    output_file_free(job.to);
    g_free(job.from);
    g_free(job.what);
    return ok ? CLI_DONE : CLI_FAILED;
}
