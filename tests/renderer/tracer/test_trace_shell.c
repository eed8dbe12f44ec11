/* The outline that paths of light see of grass on a torus, against the whole surface of the sample
 * laid around the torus (Wang et al. 2005 fig. 10). */
#include "lib/material_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/silhouettes_fixture.h"
#include "lib/test.h"
#include "lib/trace_fixture.h"
#include "tracer/trace_scene.h"

#include <math.h>

#define W       120
#define H       90
#define TILE_MM 25.0
#define SAMPLE  "{\"name\": \"sample\"}"

static TraceScene *read_torus(const char *material, const char *mdf) {
    g_autoptr(Mesh) torus = scene_torus(1.0, 0.4, 192, 96);
    for (guint k = 0; k < torus->n_vertices; k++)
        torus->vertices[k].uv[0] *= 2.0F; /* two tiles around, one across */
    const struct trace_object object = {torus, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autofree char *text = trace_fixture_text(&object, 1, SAMPLE, "", "", 0);
    g_autofree char *path = trace_fixture_write(text), *folder = g_path_get_dirname(path);
    TraceScene *scene = ok(trace_scene_read(path, ERR));
    remove_tree(folder);
    ok(trace_scene_set_material(scene, "sample", material, 1.0, ERR));
    if (mdf != NULL)
        ok(trace_scene_set_relief(scene, "sample", mdf, ERR));
    return scene;
}

/* Returns the share of the outline that a scene has in common with the traced surface. */
static double outline(const TraceScene *scene, const struct displaced_camera *c,
                      const struct displaced_pixel *truth) {
    const double half = tan(c->fov_deg * G_PI / 360.0) / MIN(c->width, c->height);
    const double e = c->elevation_deg * G_PI / 180.0, a = c->azimuth_deg * G_PI / 180.0;
    const struct vec3 back = vec3(cos(e) * cos(a), cos(e) * sin(a), sin(e));
    const struct vec3 right = vec3(-sin(a), cos(a), 0.0), up = vec3_cross(back, right);
    const struct vec3 eye = vec3_scale(back, c->distance);
    struct overlap overlap = {0};
    for (int k = 0; k < W * H; k++) {
        const double x = (2 * (k % W) + 1 - W) * half, y = (H - 2 * (k / W) - 1) * half;
        const struct vec3 direction =
            vec3_unit(vec3_sub(vec3_add(vec3_scale(right, x), vec3_scale(up, y)), back));
        struct trace_hit hit;
        overlap_add(&overlap, trace_scene_hit(scene, eye, direction, &hit),
                    truth[k].part == DISPLACED_SHAPE);
    }
    return overlap_share(&overlap);
}

GPU_TEST(grass) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *material = g_build_filename(folder, "grey.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_sized(6, 6, 2, TRUE);
    btf->layout.texel_mm = TILE_MM / 6;
    material_fixture_write(material, codecs_find("ward"), btf, "");

    g_autoptr(World) world = silhouettes_world("grass", 1.8);
    struct truth_surface surface;
    double top_mm = 0.0;
    truth_surface(world, &surface);
    for (guint k = 0; k < surface.n_vertices; k++)
        top_mm = MAX(top_mm, (double)surface.vertices[(gsize)surface.stride * k + 2]);
    const struct truth_grid grid = {TEXELS, TEXELS, TILE_MM, TILE_MM, top_mm + 0.02};
    g_autofree char *mdf = silhouettes_write_truth(world, &grid);
    const struct displaced_shape shape =
        silhouettes_displaced(&silhouettes_torus, 2, 1, FALSE, TILE_MM, grid.reference_mm);
    g_autoptr(Displaced) displaced = displaced_new(&surface, &shape);
    struct viewer_settings s = viewer_settings_default;
    s.camera_distance = 4.0;
    const struct displaced_camera camera = silhouettes_camera(&silhouettes_torus, &s, W, H);
    g_autofree struct displaced_pixel *truth =
        silhouettes_trace(&silhouettes_torus, displaced, &s, W, H);
    double shares[2];
    for (int k = 0; k < 2; k++) {
        g_autoptr(TraceScene) scene = read_torus(material, k == 1 ? mdf : NULL);
        shares[k] = outline(scene, &camera, truth);
    }
    const struct scene_options options = {2, 1, SCENE_Z_UP, FALSE};
    g_autoptr(Mesh) mesh = ok(scene_make("torus", &options, ERR));
    g_autoptr(Viewer) view = silhouettes_view(mesh, NULL);
    ok(viewer_open_mdf(view, mdf, ERR));
    s.silhouettes = TRUE;
    g_autofree float *seen = ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIT, W, H, ERR));
    const struct scores drawn = silhouettes_score(&silhouettes_torus, seen, truth, &s, W, H, FALSE);
    g_test_message("outline of the mesh %.4f, of its relief %.4f, drawn by the viewer %.4f",
                   shares[0], shares[1], overlap_share(&drawn.outline));
    g_assert_cmpfloat(fabs(shares[1] - overlap_share(&drawn.outline)), <, 0.01);
    g_assert_cmpfloat(shares[1], >, 0.95);
    g_assert_cmpfloat(shares[0], <, 0.9);
    world_fixture_clean();
}
