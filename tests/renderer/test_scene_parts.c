/* Scenes of several objects and materials: how glTF becomes one mesh, and what is drawn of it. */
#include "drawing/methods/methods.h"
#include "lib/ok.h"
#include "lib/relief_scene.h"
#include "lib/remove_tree.h"
#include "lib/silhouettes_fixture.h"
#include "lib/test.h"
#include "lib/trace_fixture.h"
#include "lib/view_fixture.h"
#include "scene/reference.h"
#include "shapes/scene_parts.h"

#define WIDTH  120
#define HEIGHT 90
#define FLOOR  -1.0F

static const char names[] = "{\"name\":\"ball\"},{\"name\":\"ground\"},{\"name\":\"other\"}";

/* Two unit spheres at x = ±1.5, z = 2, on a floor at z = 1 − 1: its own material each. */
static char *write_scene(void) {
    g_autoptr(Mesh) sphere = scene_sphere();
    g_autoptr(Mesh) plane = scene_plane();
    const struct trace_object objects[] = {
        {.mesh = plane, .material = 1, .scale = 6.0F, .move = {0.0F, 0.0F, 1.0F}},
        {.mesh = sphere, .material = 0, .scale = 1.0F, .move = {-1.5F, 0.0F, 2.0F}},
        {.mesh = sphere, .material = 2, .scale = 1.0F, .move = {1.5F, 0.0F, 2.0F}},
    };
    g_autofree char *text = trace_fixture_text(objects, 3, names, "", "", 0);
    return trace_fixture_write(text);
}

TEST(bindings) {
    const struct {
        const char *text, *name, *path;
        double tiles;
    } good[] = {{"a=b", "a", "b", 1.0},
                {"a b=/x,y/z,2.5", "a b", "/x,y/z", 2.5},
                {"a=b,c", "a", "b,c", 1.0},
                {"a=b=c,3", "a", "b=c", 3.0}};
    for (gsize k = 0; k < G_N_ELEMENTS(good); k++) {
        struct scene_binding b;
        g_assert_true(scene_binding_parse(good[k].text, &b, NULL));
        g_assert_cmpstr(b.name, ==, good[k].name);
        g_assert_cmpstr(b.path, ==, good[k].path);
        g_assert_cmpfloat(b.tiles, ==, good[k].tiles);
        scene_binding_clear(&b);
    }
    for (const char *const *bad = (const char *const[]){"a", "=b", "a=", NULL}; *bad != NULL;
         bad++) {
        g_autoptr(GError) error = NULL;
        struct scene_binding b;
        g_assert_false(scene_binding_parse(*bad, &b, &error));
        g_assert_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE);
        scene_binding_clear(&b);
    }
}

TEST(parts) {
    g_autofree char *path = write_scene(), *folder = g_path_get_dirname(path);
    const struct scene_binding bindings[] = {{"ground", "x", 1.0}, {"other", "y", 1.0}};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_read_parts(path, bindings, 2, &error);
    g_assert_no_error(error);
    g_assert_cmpint(mesh->n_parts, ==, 3);
    static const int materials[] = {0, 2, 1}; /* the floor is last */
    guint next = 0;
    for (guint k = 0; k < 3; k++) {
        const struct mesh_part *part = &mesh->parts[k];
        g_assert_cmpint(part->material, ==, materials[k]);
        g_assert_cmpint(part->first_index, ==, next);
        next += part->n_indices;
        for (guint i = part->first_index; i < next; i++) {
            const float *p = mesh->vertices[mesh->indices[i]].position;
            if (part->material == 1)
                g_assert_cmpfloat_with_epsilon((double)p[2], (double)FLOOR, 1e-5);
            else
                g_assert_cmpfloat_with_epsilon(
                    hypot(hypot((double)p[0] + (part->material == 0 ? 1.5 : -1.5), (double)p[1]),
                          (double)p[2]),
                    1.0, 1e-5);
        }
    }
    g_assert_cmpint(next, ==, mesh->n_indices);
    g_assert_cmpint(mesh->n_floor_indices, ==, 6);
    g_assert_cmpfloat_with_epsilon((double)mesh->radius, 2.5, 1e-5);
    remove_tree(folder);
}

TEST(refused) {
    g_autofree char *path = write_scene(), *folder = g_path_get_dirname(path);
    g_autoptr(Mesh) sphere = scene_sphere();
    const struct trace_object bare = {.mesh = sphere, .material = 0, .scale = 1.0F, .bare = TRUE};
    g_autofree char *text = trace_fixture_text(&bare, 1, names, "", "", 0);
    g_autofree char *bare_path = trace_fixture_write(text);
    g_autofree char *bare_folder = g_path_get_dirname(bare_path);
    const struct scene_binding wood = {"wood", "x", 1.0}, ball = {"ball", "x", 1.0};
    g_autoptr(GError) missing = NULL, untextured = NULL;
    g_assert_null(scene_read_parts(path, &wood, 1, &missing));
    g_assert_error(missing, SCENE_ERROR, SCENE_ERROR_FORMAT);
    g_assert_nonnull(strstr(missing->message, "“ball”, “ground”, “other”"));
    g_assert_null(scene_read_parts(bare_path, &ball, 1, &untextured));
    g_assert_error(untextured, SCENE_ERROR, SCENE_ERROR_NO_TEXTURE);
    remove_tree(folder);
    remove_tree(bare_folder);
}

static gboolean sphere_meets(struct vec3 from, struct vec3 d, double x) {
    const struct vec3 way = vec3_sub(from, vec3(x, 0, 0));
    const double b = vec3_dot(way, d), root = b * b - vec3_dot(way, way) + 1.0;
    return root >= 0.0 && -b + sqrt(root) > 1e-6;
}

/* A far lamp from +x: the one sphere shadows the other, and both the floor. Which material and how
 * much light each pixel has follows from the spheres' formula; the reference agrees. */
GPU_TEST(drawn) {
    g_autofree char *path = write_scene(), *folder = g_path_get_dirname(path);
    g_autofree char *first = view_fixture_write_btf(COSINE, 3, 8);
    g_autofree char *second = view_fixture_write_btf(GREY, 3, 8);
    const char *btf[] = {first, second};
    g_autofree char *file = g_build_filename(folder, "grey.exr", NULL);
    const struct scene_binding bindings[] = {{"ground", file, 2.0}};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_read_parts(path, bindings, 1, &error);
    g_autoptr(Viewer) view = view_fixture_view(COSINE, 3, 8, mesh);
    struct eigenmaps *grey = view_fixture_material(GREY, 3, 8);
    g_assert_true(eigenmaps_write(file, grey, &error));
    eigenmaps_free(grey);
    g_assert_cmpint(viewer_add_material(view, methods[0], file, 2.0, &error), ==, 1);
    g_assert_cmpint(viewer_add_material(view, methods[0], "/nowhere", 2.0, NULL), ==, -1);
    Reference *references[] = {reference_open(btf[0], &error), reference_open(btf[1], &error)};
    g_assert_no_error(error);
    struct viewer_settings s = viewer_settings_default;
    double relative = 1.0;
    s.camera_distance = 3.0;
    s.tiles_u = s.tiles_v = 1.0;
    s.shadows = TRUE;
    s.ambient = 0.0;
    s.light_theta_deg = 65.0;
    s.light_phi_deg = 20.0;
    g_autofree float *drawn =
        ok(reference_render_scene_linear(references, 2, view, &s, WIDTH, HEIGHT, &relative, ERR));
    g_autofree float *texel =
        viewer_render_geometry(view, &s, VIEWER_GEOMETRY_TEXEL, WIDTH, HEIGHT, &error);
    g_autofree float *maps = view_fixture_linear(view, &s, WIDTH, HEIGHT);
    const struct vec3 l = direction_of_deg(s.light_theta_deg, s.light_phi_deg);
    int material = 0, floor = 0, dark = 0, wrong = 0;
    for (int k = 0; k < WIDTH * HEIGHT; k++) {
        struct vec3 eye, d = view_fixture_ray(&s, (double)mesh->radius, WIDTH, HEIGHT, k % WIDTH,
                                              k / WIDTH, &eye);
        const gboolean ball = sphere_meets(eye, d, -1.5) || sphere_meets(eye, d, 1.5);
        const struct vec3 p = vec3_add(eye, vec3_scale(d, ((double)FLOOR - eye.z) / d.z));
        if (d.z > -0.05 || fabs(p.x) > 5.9 || fabs(p.y) > 5.9)
            continue;
        material += lrintf(texel[4 * k + 2]) == (ball ? 1 : 2);
        if (ball)
            continue;
        const gboolean hidden = sphere_meets(p, l, -1.5) || sphere_meets(p, l, 1.5);
        floor++;
        dark += hidden;
        wrong += (maps[4 * k] < 0.25F) != hidden;
    }
    g_test_message("%d pixels of their material, %d of the floor, %d in shadow, %d wrong; the "
                   "reference differs by %.5f",
                   material, floor, dark, wrong, relative);
    g_assert_cmpint(floor, >, 3000);
    g_assert_cmpint(dark, >, 400);
    g_assert_cmpint(wrong, <, floor / 50);
    g_assert_cmpfloat(relative, <, 0.005);
    /* The left sphere's side that faces the right one is partly in its shadow. */
    int shaded = 0, hidden_ones = 0;
    for (int k = 0; k < WIDTH * HEIGHT; k++) {
        struct vec3 eye, d = view_fixture_ray(&s, (double)mesh->radius, WIDTH, HEIGHT, k % WIDTH,
                                              k / WIDTH, &eye);
        if (!sphere_meets(eye, d, -1.5) || sphere_meets(eye, d, 1.5))
            continue;
        const struct vec3 way = vec3_sub(eye, vec3(-1.5, 0, 0));
        const double b = vec3_dot(way, d);
        const double root = b * b - vec3_dot(way, way) + 1.0;
        const struct vec3 n = vec3_add(way, vec3_scale(d, -b - sqrt(root)));
        const struct vec3 p = vec3_add(n, vec3(-1.5, 0, 0));
        if (vec3_dot(n, l) > 0.3 && sphere_meets(p, l, 1.5)) {
            shaded++;
            hidden_ones += maps[4 * k] < 0.1F; /* without the shadow n·l, above 0.3 */
        }
    }
    g_test_message("%d pixels of the left sphere in the right one's shadow, %d dark", shaded,
                   hidden_ones);
    g_assert_cmpint(shaded, >, 20);
    g_assert_cmpint(hidden_ones, >=, shaded * 9 / 10);
    for (int k = 0; k < 2; k++) {
        reference_free(references[k]);
        remove_folder(btf[k]);
    }
    remove_tree(folder);
}

/* A torus on a floor whose material is the torus's, once as one material and once as two that are
 * the same: the pictures are the same, however silhouettes are found. With another relief, or none,
 * of the floor the shadow that falls on it is another. */
GPU_TEST(relief) {
    const struct scene_options scene = {3, 3, SCENE_Z_UP, TRUE};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make("torus", &scene, &error);
    TEMPORARY_FOLDER(folder);
    g_autofree char *file = g_build_filename(folder, "grey.exr", NULL);
    g_autoptr(MdfTable) weave = relief_scene_mdf(RELIEF_WEAVE);
    const gsize n_depths = (gsize)weave->n_views * weave->width * weave->height;
    g_autofree float *halves = g_new(float, n_depths);
    struct mdf_table half = *weave;
    half.depth_mm = halves;
    for (gsize k = 0; k < n_depths; k++)
        halves[k] = 0.5F * weave->depth_mm[k];
    const struct mdf_source of_weave = {.table = weave}, of_half = {.table = &half};
    struct eigenmaps *grey = view_fixture_material(GREY, 3, 8);
    g_assert_true(eigenmaps_write(file, grey, &error));
    eigenmaps_free(grey);
    g_autoptr(Viewer) one = view_fixture_view(GREY, 3, 8, mesh);
    const guint n_torus = mesh->n_indices - mesh->n_floor_indices;
    const struct mesh_part parts[] = {{0, n_torus, 0}, {n_torus, mesh->n_floor_indices, 1}};
    mesh->parts = g_memdup2(parts, sizeof parts);
    mesh->n_parts = G_N_ELEMENTS(parts);
    g_autoptr(Viewer) two = view_fixture_view(GREY, 3, 8, mesh);
    g_assert_cmpint(viewer_add_material(two, methods[0], file, 3.0, &error), ==, 1);
    g_assert_true(viewer_set_mdf(one, &of_weave, &error));
    g_assert_true(viewer_set_mdf(two, &of_weave, &error));
    struct viewer_settings s = viewer_settings_default;
    s.silhouettes = s.shadows = TRUE;
    s.shadow_size = 512;
    s.light_theta_deg = 60.0;
    s.n_lamps = 1;
    s.lamps[0] = (struct viewer_lamp){
        .theta_deg = 50.0, .phi_deg = 80.0, .rgb = {0.4F, 0.4F, 0.1F}, .distance = 1.6};
    for (int way = 0; way < 2; way++) {
        s.visibility.way = way == 0 ? VISIBILITY_AUTO : VISIBILITY_PEEL;
        g_assert_true(viewer_set_material_mdf(two, 1, &of_weave, &error));
        g_autofree float *whole = view_fixture_linear(one, &s, WIDTH, HEIGHT);
        g_autofree float *same = view_fixture_linear(two, &s, WIDTH, HEIGHT);
        g_assert_true(viewer_set_material_mdf(two, 1, &of_half, &error));
        g_autofree float *other = view_fixture_linear(two, &s, WIDTH, HEIGHT);
        g_assert_true(viewer_set_material_mdf(two, 1, NULL, &error));
        g_autofree float *smooth = view_fixture_linear(two, &s, WIDTH, HEIGHT);
        const int n = 4 * WIDTH * HEIGHT;
        const int none = silhouettes_differ(whole, same, n, 1e-3F);
        const int shallow = silhouettes_differ(whole, other, n, 0.05F);
        const int flat = silhouettes_differ(whole, smooth, n, 0.05F);
        g_test_message("differ: %d of the same relief, %d of another, %d of none", none, shallow,
                       flat);
        g_assert_cmpint(none, ==, 0);
        g_assert_cmpint(shallow, >, 50);
        g_assert_cmpint(flat, >, 50);
    }
}
