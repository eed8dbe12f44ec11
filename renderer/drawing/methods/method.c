#include "method.h"

#include "directions/directions.h"
#include "drawing/gl/gpu.h"
#include "eigenmaps_view.h"
#include "hsh_view.h"
#include "lobes_view.h"
#include "lpca_grid.h"
#include "lpca_revised.h"
#include "lpca_view.h"
#include "microfacet.h"
#include "session/session.h"

#include <epoxy/gl.h>

#include <string.h>

const char *const method_rotation_names[METHOD_ROTATIONS] = {"exact", "approximate", "none"};

const struct method *const methods[] = {
    &method_eigenmaps,
    &method_lpca_grid,
    &method_lpca_revised,
    &method_lpca,
    &methods_lobes[LOBES_FIELDS],
    &methods_lobes[LOBES_PTM],
    &method_hsh,
    &methods_lobes[LOBES_LAFORTUNE],
    &methods_lobes[LOBES_WARD],
    &methods_lobes[LOBES_ASHIKHMIN],
    &methods_microfacet[0],
    &methods_microfacet[1],
    &methods_microfacet[2],
    &methods_microfacet[3],
    NULL,
};

const struct method *method_find(const char *name) {
    for (gsize k = 0; methods[k] != NULL; k++)
        if (strcmp(methods[k]->name, name) == 0)
            return methods[k];
    return NULL;
}

char *method_path(const struct method *method, const char *argument) {
    if (method->product != NULL && g_file_test(argument, G_FILE_TEST_IS_DIR))
        return g_build_filename(argument, "products", method->product, NULL);
    return g_strdup(argument);
}

gpointer method_open(const struct method *method, const char *path, GError **error) {
    if (method->product == NULL)
        return method->open(g_strcmp0(path, method->name) != 0 ? path : NULL, error);
    if (g_file_test(path, G_FILE_TEST_EXISTS)) {
        g_autoptr(GError) why = NULL;
        gpointer material = session_check_product(path, &why) ? method->open(path, &why) : NULL;
        if (why != NULL && strstr(why->message, path) == NULL)
            g_prefix_error(&why, "%s: ", path);
        if (why != NULL)
            g_propagate_error(error, g_steal_pointer(&why));
        return material;
    }
    g_autofree char *name = g_path_get_basename(path);
    if (g_str_equal(name, method->product))
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "there is no %s; “%s” makes it from a session", path, method->made_by);
    else
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "there is no %s; give the directory of a session, or a file that “%s” makes",
                    path, method->made_by);
    return NULL;
}

Directions *method_directions(const struct direction_list *list, const char *what,
                              gboolean triangulated, GError **error) {
    Directions *ret = (triangulated ? directions_new_triangulated : directions_new)(
        list->theta_deg, list->phi_deg, (int)list->n, error);
    if (!ret)
        g_prefix_error(error, "%s: ", what);
    return ret;
}

gboolean method_check_size(const struct btf_layout *layout, GError **error) {
    GLint size = 0;
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &size);
    if (layout->width <= (gsize)size && layout->height <= (gsize)size)
        return TRUE;
    g_set_error(error, GPU_ERROR, GPU_ERROR_TOO_LARGE,
                "%zu × %zu texels: %s supports %d in each direction; process the material with "
                "fewer texels",
                layout->width, layout->height, gpu_renderer(), size);
    return FALSE;
}
