/* compress: encodes a BTF with one of the codecs. */
#include "compress.h"
#include "materials.h"

#include "btf/btf_checkpoint.h"
#include "common/work.h"
#include "session/session.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <unistd.h>

struct compress {
    const struct compress_asked *asked;
    /* results */
    struct codec_result result;
    char *written;
    OutputFile *to; /* the output file; written is its name */
    int texels, views, lights;
    gint64 holes, bounds, raw_bytes, bytes, file_bytes;
};

static gboolean encode(struct compress *compress, const struct btf_matrix *btf,
                       const struct work *work, Checkpoint *checkpoint, GError **error) {
    const struct compress_asked *asked = compress->asked;
    const struct codec *codec = asked->method.codec;
    struct codec_result *result = &compress->result;
    const struct codec_job job = {.btf = btf,
                                  .options = asked->options,
                                  .memory = asked->memory,
                                  .work = work,
                                  .checkpoint = checkpoint};
    GStatBuf status;
    const char *path = NULL;
    if (!codec->encode(codec, &job, result, error) ||
        !(path = output_file_path(compress->to, error)))
        return FALSE;
    const gboolean written =
        codec->write(path, result->levels->pdata, (int)result->levels->len, error);
    for (guint i = 0; i < result->levels->len; i++)
        compress->bytes += codec->bytes(result->levels->pdata[i]);
    if (written && g_stat(path, &status) == 0)
        compress->file_bytes = status.st_size;
    return output_file_end(compress->to, written, error) &&
           session_add_product_file(compress->written, asked->made_by, error);
}

/* Computes the model with its errors and sizes, and writes its file. */
static gboolean compress_btf(struct compress *compress, const struct work *work, GError **error) {
    const struct compress_asked *asked = compress->asked;
    /* Half of the memory limit is for the BTF, and the other half for the computation. */
    struct btf_matrix *btf = btf_matrix_read_within(asked->memory / 2, asked->path, work, error);
    if (!btf)
        return FALSE;
    compress->texels = btf_layout_texels(&btf->layout);
    compress->views = btf->layout.views.n;
    compress->lights = btf->layout.lights.n;
    compress->holes = btf->holes;
    compress->bounds = btf->bounds;
    compress->raw_bytes = (gint64)compress->texels * btf_layout_values(&btf->layout) * 2;
    g_autofree char *path = g_strconcat(compress->written, ".checkpoint", NULL);
    g_autofree char *inputs = compress_inputs(asked);
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(path);
    btf_checkpoint_begin(checkpoint, btf, inputs);
    if (checkpoint_note(checkpoint))
        g_printerr("%s\n", checkpoint_note(checkpoint));
    const gboolean resumable = asked->method.codec->resumable && !output_file_streams(compress->to);
    const gboolean ok = encode(compress, btf, work, resumable ? checkpoint : NULL, error);
    if (ok)
        checkpoint_remove(checkpoint);
    else if (!g_cancellable_is_cancelled(work->cancellable))
        checkpoint_discard(checkpoint);
    else if (resumable)
        g_prefix_error(error, "%s keeps the work done so far: ", path);
    btf_matrix_free(btf);
    return ok;
}

/* Returns the name of the output file: the value of -o, or METHOD.exr among the products of the
 * session. In the second case, returns NULL with an error if the session cannot be opened for
 * making products. */
static char *output(const struct compress_asked *asked, GError **error) {
    if (asked->output)
        return g_strdup(asked->output);
    g_autofree char *directory = btf_matrix_session(asked->path);
    g_autofree char *name = g_strdup_printf("%s.exr", asked->method.name);
    g_autoptr(Session) session = session_open(directory, SESSION_PRODUCTS, error);
    return session ? g_build_filename(directory, "products", name, NULL) : NULL;
}

static gboolean work_compress(const struct work *work, gpointer data, GError **error) {
    struct compress *compress = data;
    compress->written = output(compress->asked, error);
    if (!compress->written)
        return FALSE;
    compress->to = (compress->asked->output ? cli_output_locked : cli_output_product)(
        compress->written, compress->asked->method.name, error);
    return compress->to && compress_btf(compress, work, error);
}

static void tell(Record *to, const struct compress *compress, double seconds) {
    const struct codec *codec = compress->asked->method.codec;
    const struct codec_result *result = &compress->result;
    const gboolean mips = options_find(compress->asked->method.options, "mips") != NULL;
    g_autofree char *what = codec->describe(codec, result);
    record_say(to, "%s{file}: done in %g{:time}: %s, error %.2f{:%%} at the measured directions",
               compress->written, seconds, what, result->error);
    record_add(to, "%s{method} %d{texels} %d{views} %d{lights}", compress->asked->method.name,
               compress->texels, compress->views, compress->lights);
    record_add(to, "%d{clusters} %d{components} %d{grid} %u{levels}", result->clusters,
               result->components, result->grid, mips ? result->levels->len : 0);
    record_add(to,
               "%" G_GINT64_FORMAT "{holes} %" G_GINT64_FORMAT "{lower_bounds} %" G_GINT64_FORMAT
               "{btf_bytes} %" G_GINT64_FORMAT "{bytes} %" G_GINT64_FORMAT "{file_bytes}",
               compress->holes, compress->bounds, compress->raw_bytes, compress->bytes,
               compress->file_bytes);
    record_add(to, "%g{exact_error} %g{error}", result->exact_error, result->error);
    if (result->luminance_error >= 0)
        record_double(to, "luminance_error", result->luminance_error);
    record_double(to, "real_s", seconds);
    if (result->packed)
        record_say(to,
                   ", %" G_GINT64_FORMAT "{:size} on disk, 1:%.3g of the BTF in half floats; "
                   "%" G_GINT64_FORMAT "{:size} unpacked\n",
                   compress->file_bytes, (double)compress->raw_bytes / (double)compress->file_bytes,
                   compress->bytes);
    else
        record_say(to,
                   " (%.2f{:%%} before %srounding), %" G_GINT64_FORMAT
                   "{:size}, 1:%.3g of the BTF in half floats; %" G_GINT64_FORMAT
                   "{:size} on disk\n",
                   result->exact_error, result->grid ? "the grid and " : "", compress->bytes,
                   (double)compress->raw_bytes / (double)compress->bytes, compress->file_bytes);
    cli_tell_output(to, compress->to);
    if (compress->holes > 0)
        record_say(to,
                   "%" G_GINT64_FORMAT " of %" G_GINT64_FORMAT
                   " values of the BTF are holes and were filled from their neighbours\n",
                   compress->holes, compress->raw_bytes / 6);
    if (compress->bounds > 0)
        record_say(to,
                   "%" G_GINT64_FORMAT
                   " are lower bounds, because the camera was saturated, and are used unchanged\n",
                   compress->bounds);
}

static int run(const struct call *call, GError **error) {
    struct compress_asked asked;
    struct compress compress = {.asked = &asked};
    double seconds = 0;
    int code = CLI_USAGE;
    if (compress_ask(call, &asked)) {
        if (asked.method.mdf)
            code = compress_mdf(&asked, call->record, error);
        else if (cli_work_run(work_compress, &compress, &seconds, error)) {
            tell(call->record, &compress, seconds);
            code = CLI_DONE;
        } else
            code = CLI_FAILED;
    }
    g_clear_pointer(&compress.result.levels, g_ptr_array_unref);
    g_free(compress.written);
    output_file_free(compress.to);
    compress_clear(&asked);
    return code;
}

const struct command cli_compress = {.name = "compress",
                                     .arguments = "DIR",
                                     .examples = "  mesorig compress weave.session --error 5%\n"
                                                 "  mesorig compress weave.session -m ptm\n",
                                     .help = "Compress the BTF or the MDF of a session.",
                                     .list_options = compress_entries,
                                     .writes = TRUE,
                                     .streams = TRUE,
                                     .min = 1,
                                     .max = 1,
                                     .run = run};
