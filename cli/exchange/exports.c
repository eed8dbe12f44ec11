/* export: writes the products of a session for other programs. */
#include "exchange.h"

#include <gio/gio.h>

#include "base/options.h"

static gboolean has_output(const char *output, const char *missing, GError **error) {
    if (output == NULL)
        g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT, missing);
    return output != NULL;
}

OutputFile *exchange_output(const char *output, const struct exchange_format *format,
                            GError **error) {
    if (!has_output(output, "no file to write is given: give -o FILE", error))
        return NULL;
    g_autofree char *lower = g_ascii_strdown(output, -1);
    if (format->end == NULL || g_str_has_suffix(lower, format->end))
        return cli_output(output, format->kind, error);
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_FILENAME,
                "%s: %s are written as %s; give a name that ends in %s", output, format->what,
                format->format, format->end);
    return NULL;
}

gboolean exchange_check_folder(const char *output, GError **error) {
    return has_output(output, "no folder to make is given: give -o DIR", error) &&
           cli_check_folder(output, error);
}

gboolean exchange_parse_bytes(const struct command *command, const char *name, const char *text,
                              gint64 *ret) {
    static const struct option bytes = {.type = OPTION_BYTES};
    g_autoptr(GError) error = NULL;
    if (!text || options_set(&bytes, text, ret, &error))
        return TRUE;
    cli_usage(command, "--%s: %s", name, error->message);
    return FALSE;
}

static const struct command *const commands[] = {
    &exchange_btf,       &exchange_points, &exchange_mesh,    &exchange_height,
    &exchange_normals,   &exchange_web,    &exchange_maps,    &exchange_gltf,
    &exchange_materialx, &exchange_usd,    &exchange_blender, &exchange_bsdf,
    &exchange_merl,      &exchange_ptm,    &exchange_relight, NULL};

const struct command exchange_export = {
    .name = "export",
    .arguments = "KIND DIR -o FILE",
    .examples = "  mesorig export btf weave.session -o weave.btf\n"
                "  mesorig export normals weave.session -o normals.exr\n"
                "  mesorig export gltf weave.session -o weave.glb\n",
    .help = "Write the products of a session for other programs.",
    .run_arguments = cli_run_child,
    .children = commands};
