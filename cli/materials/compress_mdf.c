/* compress, with a method of mdf_codecs[]: compresses the distances (MDF) of a session. */
#include "common/work.h"
#include "compress.h"
#include "session/session.h"

#include <gio/gio.h>
#include <glib/gstdio.h>

struct mdf_compression {
    const struct compress_asked *asked;
    char *from;
    OutputFile *to;
    /* results */
    struct mdf_codec_result result;
    char *what;
    int width, height, n_measured;
    gint64 file_bytes;
    double texel_mm;
};

static gboolean work_mdf(const struct work *work, gpointer data, GError **error) {
    struct mdf_compression *compression = data;
    const struct compress_asked *asked = compression->asked;
    struct mdf_table *table = session_check_product(compression->from, error)
                                  ? mdf_table_read(compression->from, error)
                                  : NULL;
    const char *to = table ? output_file_path(compression->to, error) : NULL;
    if (!to) {
        mdf_table_free(table);
        return FALSE;
    }
    const struct mdf_codec_job encode = {.from = compression->from,
                                         .to = to,
                                         .table = table,
                                         .n_measured = table->n_views,
                                         .options = asked->options,
                                         .work = work};
    compression->width = table->width;
    compression->height = table->height;
    compression->n_measured = table->n_views;
    compression->texel_mm = table->texel_mm;
    const gboolean encoded = asked->method.mdf->encode(&encode, &compression->result, error);
    GStatBuf status;
    if (encoded && g_stat(to, &status) == 0)
        compression->file_bytes = status.st_size;
    const gboolean ok = output_file_end(compression->to, encoded, error) &&
                        session_add_product_file(asked->output, asked->made_by, error);
    if (ok)
        compression->what = asked->method.mdf->describe(&encode, &compression->result);
    mdf_table_free(table);
    return ok;
}

static void tell(Record *to, const struct mdf_compression *compression, double seconds) {
    const struct mdf_codec_result *result = &compression->result;
    /* The size is compared with that of one byte per texel and view. */
    const gint64 raw_bytes =
        (gint64)compression->n_measured * compression->width * compression->height;
    record_say(to, "%s{file}: done in %g{:time}: %s; ", compression->asked->output, seconds,
               compression->what);
    record_add(to, "%s{method} %d{width} %d{height} %d{views} %d{traced_views} %d{maps}",
               compression->asked->method.name, compression->width, compression->height,
               compression->n_measured, result->n_traced, result->n_terms);
    record_add(to,
               "%" G_GINT64_FORMAT "{mdf_bytes} %" G_GINT64_FORMAT "{bytes} %" G_GINT64_FORMAT
               "{file_bytes}",
               raw_bytes, result->bytes, compression->file_bytes);
    record_say(to,
               "error %.3f{error_mm} mm RMS (%.3f texels), below %.3f{error_99_mm} mm for 99 %%; "
               "%" G_GINT64_FORMAT "{:size}, 1:%.1f of the views in 8 bit; %" G_GINT64_FORMAT
               "{:size} on disk\n",
               result->error_mm, result->error_mm / compression->texel_mm, result->error_99_mm,
               result->bytes, (double)raw_bytes / (double)result->bytes, compression->file_bytes);
    record_add(to, "%g{texel_mm} %g{real_s}", compression->texel_mm, seconds);
    cli_tell_output(to, compression->to);
}

int compress_mdf(const struct compress_asked *asked, Record *to, GError **error) {
    struct mdf_compression compression = {.asked = asked};
    double seconds = 0;
    compression.from = g_file_test(asked->path, G_FILE_TEST_IS_DIR)
                           ? g_build_filename(asked->path, "products", "mdf.exr", NULL)
                           : g_strdup(asked->path);
    compression.to = cli_output_locked(asked->output, asked->method.mdf->kind, error);
    const gboolean ok = compression.to && cli_work_run(work_mdf, &compression, &seconds, error);
    if (ok)
        tell(to, &compression, seconds);
    output_file_free(compression.to);
    g_free(compression.from);
    g_free(compression.what);
    return ok ? CLI_DONE : CLI_FAILED;
}
