/* compress: a BTF, encoded by one of the codecs. */
#include "compress.h"

#include "base/file_lock.h"
#include "base/new_file.h"
#include "btf/btf_checkpoint.h"
#include "command/cli.h"
#include "command/work.h"
#include "plan/report.h"
#include "session/session.h"

#include <glib/gstdio.h>
#include <unistd.h>

struct compress {
    const struct compress_asked *asked;
    /* found */
    struct codec_result result;
    char *written;
    int texels, views, lights;
    gint64 holes, bounds, raw_bytes, bytes, file_bytes;
};

static gboolean cli_compress_check_output(const char *output, GError **error) {
    g_autofree char *folder = g_path_get_dirname(output);
    if (g_access(folder, W_OK) == 0)
        return TRUE;
    g_set_error(error, EXR_ERROR, EXR_ERROR_IO, "%s: files cannot be written into that folder",
                folder);
    return FALSE;
}

static Checkpoint *cli_compress_checkpoint(const struct compress *compress,
                                           const struct btf_matrix *btf) {
    g_autofree char *path = g_strconcat(compress->written, ".checkpoint", NULL);
    g_autofree char *inputs = compress_inputs(compress->asked);
    Checkpoint *checkpoint = checkpoint_new(path);
    btf_checkpoint_begin(checkpoint, btf, inputs);
    if (checkpoint_note(checkpoint))
        g_printerr("%s\n", checkpoint_note(checkpoint));
    return checkpoint;
}

static gboolean cli_compress_encode(struct compress *compress, const struct btf_matrix *btf,
                                    const struct work *work, Checkpoint *checkpoint,
                                    GError **error) {
    const struct codec *codec = compress->asked->method.codec;
    struct codec_result *result = &compress->result;
    const struct codec_job job = {.btf = btf,
                                  .options = compress->asked->options,
                                  .memory = compress->asked->memory,
                                  .work = work,
                                  .checkpoint = codec->resumable ? checkpoint : NULL};
    if (!codec->encode(codec, &job, result, error) ||
        !codec->write(compress->written, result->levels->pdata, (int)result->levels->len, error))
        return FALSE;
    for (guint i = 0; i < result->levels->len; i++)
        compress->bytes += codec->bytes(result->levels->pdata[i]);
    return session_add_product_file(compress->written, compress->asked->made_by, error);
}

/* The result, its figures and its file. */
static gboolean compress_btf(struct compress *compress, const struct work *work, GError **error) {
    /* What is left of the limit is for the work. */
    struct btf_matrix *btf =
        btf_matrix_read_within(compress->asked->memory / 2, compress->asked->path, work, error);
    if (!btf)
        return FALSE;
    compress->texels = btf_layout_texels(&btf->layout);
    compress->views = btf->layout.views.n;
    compress->lights = btf->layout.lights.n;
    compress->holes = btf->holes;
    compress->bounds = btf->bounds;
    compress->raw_bytes = (gint64)compress->texels * btf_layout_values(&btf->layout) * 2;
    g_autoptr(Checkpoint) checkpoint = cli_compress_checkpoint(compress, btf);
    const gboolean ok = cli_compress_encode(compress, btf, work, checkpoint, error);
    if (ok)
        checkpoint_remove(checkpoint);
    else if (!g_cancellable_is_cancelled(work->cancellable))
        checkpoint_discard(checkpoint);
    else if (compress->asked->method.codec->resumable)
        g_prefix_error(error, "%s.checkpoint keeps what is done: ", compress->written);
    btf_matrix_free(btf);
    GStatBuf status;
    if (ok && g_stat(compress->written, &status) == 0)
        compress->file_bytes = status.st_size;
    return ok;
}

/* Where to, if that can be written. */
static char *cli_compress_place(const struct compress *compress, GError **error) {
    if (compress->asked->output)
        return cli_compress_check_output(compress->asked->output, error)
                   ? g_strdup(compress->asked->output)
                   : NULL;
    g_autofree char *directory = btf_matrix_session(compress->asked->path);
    g_autofree char *name = g_strdup_printf("%s.exr", compress->asked->method.name);
    g_autoptr(Session) session = session_open(directory, SESSION_PRODUCTS, error);
    return session ? g_build_filename(directory, "products", name, NULL) : NULL;
}

int compress_lock(const char *path, char **ret_lock, GError **error) {
    g_autofree char *folder = g_path_get_dirname(path), *name = g_path_get_basename(path);
    g_autofree char *prefix = g_strconcat(name, ".", NULL);
    *ret_lock = g_strconcat(path, ".lock", NULL);
    const int lock = file_lock_take(*ret_lock, path, error);
    if (lock >= 0)
        new_file_remove_left(folder, "", prefix);
    return lock;
}

static gboolean cli_compress_work(const struct work *work, gpointer data, GError **error) {
    struct compress *compress = data;
    g_autofree char *lock_path = NULL;
    compress->written = cli_compress_place(compress, error);
    const int lock = compress->written ? compress_lock(compress->written, &lock_path, error) : -1;
    const gboolean ok = lock >= 0 && compress_btf(compress, work, error);
    file_lock_give(lock, lock_path);
    return ok;
}

/* Levels are 0 of a codec that makes no mip levels. */
static int cli_compress_levels(const struct compress *compress) {
    for (const struct option *option = compress->asked->method.options; option->name; option++)
        if (g_str_equal(option->name, "mips"))
            return (int)compress->result.levels->len;
    return 0;
}

static void cli_compress_tell_json(const struct compress *compress, double seconds) {
    const struct codec_result *result = &compress->result;
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    const struct {
        const char *name;
        gint64 value;
    } numbers[] = {
        {"texels", compress->texels},
        {"views", compress->views},
        {"lights", compress->lights},
        {"clusters", result->clusters},
        {"components", result->components},
        {"grid", result->grid},
        {"levels", cli_compress_levels(compress)},
        {"holes", compress->holes},
        {"lower_bounds", compress->bounds},
        {"btf_bytes", compress->raw_bytes},
        {"bytes", compress->bytes},
        {"file_bytes", compress->file_bytes},
    };
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(compress->written));
    g_variant_builder_add(&builder, "{sv}", "method",
                          g_variant_new_string(compress->asked->method.name));
    for (gsize i = 0; i < G_N_ELEMENTS(numbers); i++)
        g_variant_builder_add(&builder, "{sv}", numbers[i].name,
                              g_variant_new_int64(numbers[i].value));
    g_variant_builder_add(&builder, "{sv}", "exact_error",
                          g_variant_new_double(result->exact_error));
    g_variant_builder_add(&builder, "{sv}", "error", g_variant_new_double(result->error));
    if (result->luminance_error >= 0)
        g_variant_builder_add(&builder, "{sv}", "luminance_error",
                              g_variant_new_double(result->luminance_error));
    g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
    cli_print_json(g_variant_builder_end(&builder));
}

static void cli_compress_tell(const struct compress *compress, double seconds) {
    if (cli_json) {
        cli_compress_tell_json(compress, seconds);
        return;
    }
    const struct codec *codec = compress->asked->method.codec;
    const struct codec_result *result = &compress->result;
    g_autofree char *time = report_duration(seconds);
    g_autofree char *what = codec->describe(codec, result);
    g_autofree char *size = g_format_size((guint64)compress->bytes);
    g_autofree char *file = g_format_size((guint64)compress->file_bytes);
    if (result->packed)
        g_print("%s: done in %s: %s, error %.2f %%, %s on disk, 1:%.3g of the BTF in half floats; "
                "%s unpacked\n",
                compress->written, time, what, 100 * result->error, file,
                (double)compress->raw_bytes / (double)compress->file_bytes, size);
    else
        g_print("%s: done in %s: %s, error %.2f %% (%.2f %% before %srounding), %s, 1:%.3g of the "
                "BTF in half floats; %s on disk\n",
                compress->written, time, what, 100 * result->error, 100 * result->exact_error,
                result->grid ? "the grid and " : "", size,
                (double)compress->raw_bytes / (double)compress->bytes, file);
    if (compress->holes > 0)
        g_print("%" G_GINT64_FORMAT " of %" G_GINT64_FORMAT
                " values of the BTF are holes and were filled from what is around them\n",
                compress->holes, compress->raw_bytes / 6);
    if (compress->bounds > 0)
        g_print("%" G_GINT64_FORMAT " are lower bounds, since the camera was saturated, and were "
                "taken as they are\n",
                compress->bounds);
}

static int cli_compress_run(const struct command *command, int argc, char **argv) {
    struct compress_asked asked;
    struct compress compress = {.asked = &asked};
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    int code = CLI_USAGE;
    if (compress_parse(command, &argc, &argv, &asked)) {
        if (asked.method.mdf)
            code = compress_mdf(&asked);
        else if (cli_work_run(cli_compress_work, &compress, &seconds, &error)) {
            cli_compress_tell(&compress, seconds);
            code = CLI_DONE;
        } else
            code = cli_fail(error);
    }
    g_clear_pointer(&compress.result.levels, g_ptr_array_unref);
    g_free(compress.written);
    compress_clear(&asked);
    return code;
}

const struct command cli_compress = {.name = "compress",
                                     .arguments = "DIR",
                                     .help = "Compress the BTF of a session, or its MDF.",
                                     .run_arguments = cli_compress_run};
