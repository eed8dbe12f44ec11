#include "scene_files.h"

#include <gio/gio.h>

#include "drawing/methods/methods.h"
#include "scene/file_kind.h"

struct mesh *scene_files_mesh(const struct viewer_options *o, const char *shape,
                              const struct scene_options *how, GError **error) {
    if (o->n_bindings == 0 || g_strcmp0(shape, o->shape) != 0)
        return scene_make(shape, how, error);
    struct mesh *mesh = scene_read_parts(shape, o->bindings, (guint)o->n_bindings, error);
    if (mesh != NULL && how->tiles_u > 0.0 && how->tiles_v > 0.0) {
        mesh->tiles_u = how->tiles_u;
        mesh->tiles_v = how->tiles_v;
    }
    return mesh;
}

static const struct method *session_method(const char *session) {
    const struct method *method = method_of_session(session);
    return method != NULL ? method : methods[0]; /* its error says how to make the file */
}

/* Returns the method that draws path. For a compressed file, this is the method of the file. For a
 * session, it is the given method if --method named it and it can open files, and otherwise the
 * result of session_method(). Returns NULL with an error if path is neither. */
static const struct method *scene_files_method(const struct method *method, gboolean named,
                                               const char *path, GError **error) {
    struct file_opened file;
    if (g_file_test(path, G_FILE_TEST_IS_DIR))
        return named && method->product != NULL ? method : session_method(path);
    if (!file_kind_find(path, &file, error))
        return NULL;
    const struct method *found = file.kind == FILE_KIND_MATERIAL ? file.method : NULL;
    file_opened_clear(&file);
    if (found == NULL)
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "--material: %s is neither a session nor a compressed material; give the "
                    "directory of a session or a file that “mesorig compress” made",
                    path);
    return found;
}

static gboolean add(const struct scene_binding *binding, const struct method *method,
                    gboolean named, gboolean relief, Viewer *viewer, GError **error) {
    const struct method *own = scene_files_method(method, named, binding->path, error);
    if (own == NULL)
        return FALSE;
    g_autofree char *path = method_path(own, binding->path);
    g_autofree char *folder = g_path_get_dirname(path);
    g_autofree char *mdf = g_build_filename(folder, "mdf.exr", NULL);
    const int number = viewer_add_material(viewer, own, path, binding->tiles, error);
    return number >= 0 && (!relief || !g_file_test(mdf, G_FILE_TEST_EXISTS) ||
                           viewer_open_material_mdf(viewer, number, mdf, error));
}

gboolean scene_files_open(const struct viewer_options *o, const struct method *method,
                          gboolean relief, Viewer *viewer, GError **error) {
    for (int k = 0; k < o->n_bindings; k++)
        if (!add(&o->bindings[k], method, o->method_name != NULL, relief, viewer, error))
            return FALSE;
    return TRUE;
}

Reference *scene_files_reference(const char *path, GError **error) {
    if (g_file_test(path, G_FILE_TEST_IS_REGULAR))
        return reference_open_material(path, error);
    g_autofree char *btf = g_build_filename(path, "products", "btf", NULL);
    return reference_open(btf, error);
}
