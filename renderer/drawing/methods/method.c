#include "method.h"

#include "directions/directions.h"
#include "drawing/gl/gpu.h"

#include <epoxy/gl.h>

const char *const method_rotation_names[METHOD_ROTATIONS] = {"exact", "approximate", "none"};

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
                "the material has %zu × %zu texels, but %s supports %d in each direction; process "
                "the material with fewer texels",
                layout->width, layout->height, gpu_renderer(), size);
    return FALSE;
}
