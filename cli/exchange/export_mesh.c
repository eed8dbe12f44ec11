/* export mesh: writes the surface of a session's material as a closed mesh. */
#include "formats/export_mesh.h"

#include <gio/gio.h>

#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"

static char *output;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "File to write", "FILE"},
    {NULL},
};

/* In the order of enum export_mesh_form. */
static const struct exchange_format formats[] = {{"meshes", "PLY", ".ply", "mesh"},
                                                 {"meshes", "OBJ", ".obj", "mesh"},
                                                 {"meshes", "glTF", ".glb", NULL}};

struct mesh_export {
    const char *session;
    enum export_mesh_form form;
    struct export_mesh_result result;
};

static gboolean write_mesh(const char *path, const struct work *work, gpointer data,
                           GError **error) {
    struct mesh_export *export = data;
    return export_mesh(export->session, path, export->form, &export->result, error);
}

static int mesh_run(const struct call *call, GError **error) {
    struct mesh_export export = {.session = call->arguments[0]};
    const struct export_mesh_result *result = &export.result;
    g_autofree char *lower = output != NULL ? g_ascii_strdown(output, -1) : NULL;
    double seconds = 0.0;
    while (lower != NULL && export.form < EXPORT_MESH_GLB &&
           !g_str_has_suffix(lower, formats[export.form].end))
        export.form++;
    if (lower != NULL && !g_str_has_suffix(lower, formats[export.form].end)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_FILENAME,
                    "%s: meshes are written as PLY, OBJ or glTF; give a name that ends in .ply, "
                    ".obj or .glb",
                    output);
        return CLI_FAILED;
    }
    g_autoptr(OutputFile) to = exchange_output(output, &formats[export.form], error);
    if (to == NULL || !cli_work_write(to, write_mesh, &export, &seconds, error))
        return CLI_FAILED;
    record_add(call->record, "%s{file} %d{views} %u{vertices} %u{triangles} %g{real_s}", output,
               result->n_views, result->n_vertices, result->n_triangles, seconds);
    record_say(call->record, "%s: %u triangles between %u vertices, from %d %s\n", output,
               result->n_triangles, result->n_vertices, PLURAL(result->n_views, "view"));
    cli_tell_output(call->record, to);
    return CLI_DONE;
}

const struct command exchange_mesh = {
    .name = "export mesh",
    .arguments = "DIR -o FILE.ply|FILE.obj|FILE.glb",
    .examples = "  mesorig export mesh grass.session -o grass.glb\n",
    .help = "Export the measured surface as a closed mesh with overhangs (PLY, OBJ or glTF).",
    .options = entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = mesh_run};
