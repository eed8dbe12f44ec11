/* compress --method=mdf: the distances of a session in fewer bytes. */
#include "base/file_lock.h"
#include "command/cli.h"
#include "command/work.h"
#include "compress.h"
#include "mdf_codecs/mdf_blocks.h"
#include "mdf_codecs/mdf_factors.h"
#include "mdf_codecs/mdf_packed.h"
#include "plan/report.h"

#include <glib/gstdio.h>

#define TERMS 8

struct job {
    const struct compress_mdf *asked;
    char *from;
    /* found */
    int width, height, n_measured, n_traced, n_terms;
    gint64 bytes, file_bytes;
    double texel_mm, error_mm, most_mm;
    gint64 begun_us;
};

static struct mdf_factors *cli_compress_mdf_factor(struct job *job, struct mdf_table *table,
                                                   const struct work *work, GError **error) {
    const struct compress_mdf *asked = job->asked;
    const int most = asked->terms > 0    ? asked->terms
                     : asked->target > 0 ? MDF_FACTORS_MAX_TERMS
                                         : TERMS;
    mdf_table_add_grazing(table);
    if (!work_tell(work, "maps", 1, 3, job->begun_us, error))
        return NULL;
    return mdf_factors_compute(table, job->n_measured, most, asked->target * table->texel_mm,
                               work->cancellable, error);
}

static gboolean make_factors(struct job *job, struct mdf_table *table, const struct work *work,
                             GError **error) {
    struct mdf_factors *factors = cli_compress_mdf_factor(job, table, work, error);
    gboolean ok = factors != NULL;
    if (ok) {
        struct mdf_table *is = mdf_factors_table(factors);
        job->n_terms = factors->n_terms;
        job->n_traced = factors->n_views - factors->n_measured;
        job->bytes = mdf_factors_bytes(factors);
        job->error_mm = mdf_table_difference(table, job->n_measured, is, &job->most_mm);
        mdf_table_free(is);
        ok = work_tell(work, "maps", 2, 3, job->begun_us, error) &&
             mdf_factors_write(job->asked->output, factors, error);
    }
    mdf_factors_free(factors);
    return ok;
}

static gboolean cli_compress_mdf_make_views(struct job *job, const struct mdf_table *table,
                                            GError **error) {
    const enum mdf_packed kind =
        job->asked->kind == COMPRESS_MDF_HALF ? MDF_PACKED_HALF : MDF_PACKED_8BIT;
    if (!mdf_pack(job->from, job->asked->output, kind, &job->bytes, error))
        return FALSE;
    struct mdf_table *is = mdf_table_read(job->asked->output, error);
    if (is)
        job->error_mm = mdf_table_difference(table, job->n_measured, is, &job->most_mm);
    mdf_table_free(is);
    return is != NULL;
}

static gboolean make_blocks(struct job *job, const struct mdf_table *table, GError **error) {
    struct mdf_blocks *blocks = mdf_blocks_new(table);
    struct mdf_table *is = mdf_blocks_table(blocks);
    job->error_mm = mdf_table_difference(table, job->n_measured, is, &job->most_mm);
    job->bytes = (gint64)mdf_blocks_bytes(table->width, table->height) * table->n_views;
    const gboolean ok = mdf_blocks_write(job->asked->output, blocks, error);
    mdf_table_free(is);
    mdf_blocks_free(blocks);
    return ok;
}

static gboolean cli_compress_mdf_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    job->begun_us = g_get_monotonic_time();
    struct mdf_table *table =
        session_check_product(job->from, error) ? mdf_table_read(job->from, error) : NULL;
    if (!table)
        return FALSE;
    job->width = table->width;
    job->height = table->height;
    job->n_measured = table->n_views;
    job->texel_mm = table->texel_mm;
    const enum compress_mdf_kind kind = job->asked->kind;
    const gboolean ok =
        (kind == COMPRESS_MDF_MAPS   ? make_factors(job, table, work, error)
         : kind == COMPRESS_MDF_4BIT ? make_blocks(job, table, error)
                                     : cli_compress_mdf_make_views(job, table, error)) &&
        session_add_product_file(job->asked->output, job->asked->made_by, error);
    GStatBuf status;
    if (ok && g_stat(job->asked->output, &status) == 0)
        job->file_bytes = status.st_size;
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
        {"width", job->width},      {"height", job->height},
        {"views", job->n_measured}, {"traced_views", job->n_traced},
        {"maps", job->n_terms},     {"mdf_bytes", bytes_as_published(job)},
        {"bytes", job->bytes},      {"file_bytes", job->file_bytes},
    };
    const struct {
        const char *name;
        double value;
    } sizes[] = {{"error_mm", job->error_mm},
                 {"error_99_mm", job->most_mm},
                 {"texel_mm", job->texel_mm},
                 {"real_s", seconds}};
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(job->asked->output));
    g_variant_builder_add(
        &builder, "{sv}", "method",
        g_variant_new_string(job->asked->kind == COMPRESS_MDF_MAPS ? "mdf" : "mdf-views"));
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        g_variant_builder_add(&builder, "{sv}", numbers[i].name,
                              g_variant_new_int64(numbers[i].value));
    for (gsize i = 0; i < G_N_ELEMENTS(sizes); i++)
        g_variant_builder_add(&builder, "{sv}", sizes[i].name,
                              g_variant_new_double(sizes[i].value));
    cli_print_json(g_variant_builder_end(&builder));
}

static const char *const kinds[] = {"", "half floats", "8 bit", "4 bit"};

static void cli_compress_mdf_tell(const struct job *job, double seconds) {
    if (cli_json) {
        cli_compress_mdf_tell_json(job, seconds);
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_autofree char *size = g_format_size((guint64)job->bytes);
    g_autofree char *file = g_format_size((guint64)job->file_bytes);
    g_autofree char *what =
        job->asked->kind == COMPRESS_MDF_MAPS
            ? g_strdup_printf("%d maps for %d views, and %d traced ones along the surface",
                              job->n_terms, job->n_measured, job->n_traced)
            : g_strdup_printf("%d views in %s", job->n_measured, kinds[job->asked->kind]);
    g_print("%s: done in %s: %s; off by %.3f mm RMS (%.3f texels), 99 %% by less than %.3f mm; "
            "%s, 1:%.1f of the views in 8 bit; %s on disk\n",
            job->asked->output, time, what, job->error_mm, job->error_mm / job->texel_mm,
            job->most_mm, size, (double)bytes_as_published(job) / (double)job->bytes, file);
}

int compress_mdf(const struct compress_mdf *asked) {
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
    return ok ? CLI_DONE : cli_fail(error);
}
