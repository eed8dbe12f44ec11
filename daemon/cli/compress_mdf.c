/* compress --method=mdf: the distances of a session in fewer bytes. */
#include "base/file_lock.h"
#include "command/cli.h"
#include "command/work.h"
#include "compress.h"
#include "plan/report.h"
#include "session/session.h"

#include <glib/gstdio.h>

struct job {
    const struct compress_asked *asked;
    char *from;
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
    if (!table)
        return FALSE;
    const struct mdf_codec_job encode = {.from = job->from,
                                         .to = asked->output,
                                         .table = table,
                                         .n_measured = table->n_views,
                                         .options = asked->options,
                                         .work = work};
    job->width = table->width;
    job->height = table->height;
    job->n_measured = table->n_views;
    job->texel_mm = table->texel_mm;
    const gboolean ok = asked->method.mdf->encode(&encode, &job->result, error) &&
                        session_add_product_file(asked->output, asked->made_by, error);
    GStatBuf status;
    if (ok && g_stat(asked->output, &status) == 0)
        job->file_bytes = status.st_size;
    if (ok)
        job->what = asked->method.mdf->describe(&encode, &job->result);
    mdf_table_free(table);
    return ok;
}

static gint64 bytes_as_published(const struct job *job) {
    return (gint64)job->n_measured * job->width * job->height;
}

static void cli_compress_mdf_tell_json(const struct job *job, double seconds) {
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    const struct {
        const char *name;
        gint64 value;
    } numbers[] = {
        {"width", job->width},         {"height", job->height},
        {"views", job->n_measured},    {"traced_views", job->result.n_traced},
        {"maps", job->result.n_terms}, {"mdf_bytes", bytes_as_published(job)},
        {"bytes", job->result.bytes},  {"file_bytes", job->file_bytes},
    };
    const struct {
        const char *name;
        double value;
    } sizes[] = {{"error_mm", job->result.error_mm},
                 {"error_99_mm", job->result.most_mm},
                 {"texel_mm", job->texel_mm},
                 {"real_s", seconds}};
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(job->asked->output));
    g_variant_builder_add(&builder, "{sv}", "method",
                          g_variant_new_string(job->asked->method.name));
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        g_variant_builder_add(&builder, "{sv}", numbers[i].name,
                              g_variant_new_int64(numbers[i].value));
    for (gsize i = 0; i < G_N_ELEMENTS(sizes); i++)
        g_variant_builder_add(&builder, "{sv}", sizes[i].name,
                              g_variant_new_double(sizes[i].value));
    cli_print_json(g_variant_builder_end(&builder));
}

static void cli_compress_mdf_tell(const struct job *job, double seconds) {
    if (cli_json) {
        cli_compress_mdf_tell_json(job, seconds);
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_autofree char *size = g_format_size((guint64)job->result.bytes);
    g_autofree char *file = g_format_size((guint64)job->file_bytes);
    g_print("%s: done in %s: %s; off by %.3f mm RMS (%.3f texels), 99 %% by less than %.3f mm; "
            "%s, 1:%.1f of the views in 8 bit; %s on disk\n",
            job->asked->output, time, job->what, job->result.error_mm,
            job->result.error_mm / job->texel_mm, job->result.most_mm, size,
            (double)bytes_as_published(job) / (double)job->result.bytes, file);
}

int compress_mdf(const struct compress_asked *asked) {
    g_autoptr(GError) error = NULL;
    struct job job = {.asked = asked};
    double seconds = 0;
    job.from = g_file_test(asked->path, G_FILE_TEST_IS_DIR)
                   ? g_build_filename(asked->path, "products", "mdf.exr", NULL)
                   : g_strdup(asked->path);
    g_autofree char *lock_path = NULL;
    const int lock = compress_lock(asked->output, &lock_path, &error);
    const gboolean ok = lock >= 0 && cli_work_run(cli_compress_mdf_work, &job, &seconds, &error);
    file_lock_give(lock, lock_path);
    if (ok)
        cli_compress_mdf_tell(&job, seconds);
    g_free(job.from);
    g_free(job.what);
    return ok ? CLI_DONE : cli_fail(error);
}
