/* export: the products of a session, for other programs. */
#include "exchange.h"

gboolean exchange_check_output(const char *output, const char *what, const char *format,
                               const char *end, GError **error) {
    if (output == NULL) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "no file to write is given: give -o FILE");
        return FALSE;
    }
    g_autofree char *lower = g_ascii_strdown(output, -1);
    if (end == NULL || g_str_has_suffix(lower, end))
        return cli_check_target(output, error);
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_FILENAME,
                "%s: %s are written as %s; give a name that ends in %s", output, what, format, end);
    return FALSE;
}

static const struct command *const commands[] = {&exchange_btf,     &exchange_points,
                                                 &exchange_height,  &exchange_normals,
                                                 &exchange_web,     &exchange_maps,
                                                 &exchange_gltf,    &exchange_materialx,
                                                 &exchange_blender, &exchange_bsdf,
                                                 &exchange_merl,    &exchange_ptm,
                                                 &exchange_relight, NULL};

const struct command exchange_export = {
    .name = "export",
    .arguments = "KIND DIR -o FILE",
    .examples = "  mesorig export btf weave.session -o weave.btf\n"
                "  mesorig export normals weave.session -o normals.exr\n"
                "  mesorig export gltf weave.session -o weave.glb\n",
    .help = "Write what a session has become for other programs.",
    .run_arguments = cli_run_child,
    .children = commands};
