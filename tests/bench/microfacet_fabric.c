#include "microfacet_parts.h"

#include "drawing/gl/gpu.h"
#include "drawing/methods/methods.h"
#include "drawing/methods/microfacet.h"
#include "lib/view_picture.h"
#include "scene/picture.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <epoxy/gl.h>
#include <string.h>

#define WIDTH  300
#define HEIGHT 225
#define YARNS  16 /* as in microfacet_view.c */

static const struct method *fabric_base; /* of the method that is drawn */

/* Yarns without slopes: their directions and colours alternate, their normals are the surface's. */
static void fabric_bind_flat(gpointer material, guint program, const struct method_style *style) {
    fabric_base->bind(material, program, style);
    glUniform3f(glGetUniformLocation(program, "weave"), YARNS, 0, 0);
}

gboolean microfacet_fabric(const char *path, GError **error) {
    static struct method flat;
    static const struct {
        gboolean flat;
        enum method_rotation rotation;
    } pictures[] = {{TRUE, METHOD_ROTATION_NONE},
                    {FALSE, METHOD_ROTATION_NONE},
                    {FALSE, METHOD_ROTATION_EXACT}};
    const gsize n = G_N_ELEMENTS(pictures), row = (gsize)3 * WIDTH;
    g_autoptr(Gpu) gpu = gpu_new_headless(error);
    g_autoptr(Viewer) viewer = gpu ? viewer_new(NULL, error) : NULL;
    g_autoptr(Mesh) mesh = scene_shape("torus", SCENE_Z_UP, error);
    g_autofree guint8 *all = g_new(guint8, n * row * HEIGHT);
    gboolean good = viewer && mesh && viewer_set_mesh(viewer, mesh, error);
    fabric_base = method_find("fabric-ashikhmin");
    flat = *fabric_base;
    flat.bind = fabric_bind_flat;
    for (gsize k = 0; good && k < n; k++) {
        struct viewer_settings s = viewer_settings_default;
        s.tiles_u = 2;
        s.tiles_v = 1;
        s.samples = 2;
        s.style.rotation = pictures[k].rotation;
        g_autofree guint8 *one =
            viewer_open(viewer, pictures[k].flat ? &flat : fabric_base, NULL, error)
                ? view_picture(viewer, &s, WIDTH, HEIGHT, error)
                : NULL;
        good = one != NULL;
        for (gsize y = 0; good && y < HEIGHT; y++)
            memcpy(all + (y * n + k) * row, one + y * row, row);
    }
    return good && picture_write_png(path, all, (int)n * WIDTH, HEIGHT, NULL, error);
}
