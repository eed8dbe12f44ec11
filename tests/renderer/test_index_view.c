/* Materials seen through an index map, against the same materials with the map's texels laid out in
 * full: the pictures must not differ. */
#include "lib/lobes_scene.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/silhouettes_fixture.h"
#include "lib/view_fixture.h"
#include "scene/reference.h"

#define MAP_W 12
#define MAP_H 10
#define LOW   0.002F /* tolerance: maps are halves, and coordinates are rounded differently */

/* Patches of the sample next to each other, in which each place has another source: seams of all
 * shapes, and texels that continue each other, within the map and where it repeats. */
static struct index_map *new_map(int sample_width, int sample_height) {
    struct index_map *map = index_map_new(MAP_W, MAP_H, sample_width, sample_height, 1, "quilting");
    GRand *random = g_rand_new_with_seed(5);
    for (int patch = 0; patch < 40; patch++) {
        const int x = g_rand_int_range(random, 0, MAP_W), y = g_rand_int_range(random, 0, MAP_H);
        const int from_x = patch == 0 ? 0 : g_rand_int_range(random, 0, sample_width);
        const int from_y = patch == 0 ? 0 : g_rand_int_range(random, 0, sample_height);
        const int size = patch == 0 ? MAP_W : 4;
        for (int k = 0; k < size * size; k++) {
            guint16 *to =
                map->levels[0] + 2 * ((y + k / size) % MAP_H * MAP_W + (x + k % size) % MAP_W);
            to[0] = (guint16)((from_x + k % size) % sample_width);
            to[1] = (guint16)((from_y + k / size) % sample_height);
        }
    }
    g_rand_free(random);
    return map;
}

/* rows of n floats for each texel of the sample become those of the map. */
static float *laid_out(const float *sample, const struct index_map *map, gsize n) {
    float *ret = g_new(float, n *MAP_W *MAP_H);
    for (gsize i = 0; i < MAP_W * MAP_H; i++) {
        const guint16 *s = map->levels[0] + 2 * i;
        memcpy(ret + n * i, sample + n * ((gsize)s[1] * (gsize)map->sample_width + s[0]),
               n * sizeof(float));
    }
    return ret;
}

static struct eigenmaps *laid_out_maps(const struct eigenmaps *from, const struct index_map *map) {
    const gsize n = (gsize)from->n_terms * from->layout.lights.n;
    struct eigenmaps *to = g_new0(struct eigenmaps, 1);
    *to = *from;
    to->name = g_strdup(from->name);
    to->layout = btf_layout_copy(&from->layout);
    to->layout.width = MAP_W;
    to->layout.height = MAP_H;
    to->weights =
        g_memdup2(from->weights, sizeof(float) * (gsize)from->n_terms * from->layout.views.n);
    to->maps = g_new(float, 3 * n * MAP_W * MAP_H);
    for (gsize k = 0; k < n; k++) {
        g_autofree float *one =
            laid_out(from->maps + k * 3 * btf_layout_texels(&from->layout), map, 3);
        memcpy(to->maps + k * 3 * MAP_W * MAP_H, one, sizeof(float) * 3 * MAP_W * MAP_H);
    }
    return to;
}

/* Settings under which the map and what is laid out have texels of the same size. */
static struct viewer_settings settings_of(const struct index_map *map, double repeats) {
    struct viewer_settings s = view_fixture_settings();
    s.tiles_u = map ? repeats * MAP_W / map->sample_width : repeats;
    s.tiles_v = map ? repeats * MAP_H / map->sample_height : repeats;
    s.ambient = 0.1;
    s.camera_distance = 2.5;
    return s;
}

/* How many values of two pictures differ, of those that show the mesh. */
static int count_different(const float *a, const float *b, int pixels, float most) {
    int n = 0;
    for (int i = 0; i < 4 * pixels; i++)
        n += fabsf(a[i] - b[i]) > most;
    return n;
}

/* Without filtering, each pixel has its texel's value, also where the map repeats on a torus. */
GPU_TEST(texels) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 128, 64);
    g_autoptr(IndexMap) map = new_map(W, H);
    struct eigenmaps *sample = view_fixture_material(TEXEL, 6, 12);
    struct eigenmaps *whole = laid_out_maps(sample, map);
    g_autoptr(Viewer) through = viewer_new(sample, &error), laid = viewer_new(whole, &error);
    g_assert_no_error(error);
    g_assert_true(viewer_set_mesh(through, mesh, &error) && viewer_set_mesh(laid, mesh, &error) &&
                  viewer_set_index(through, map, &error));
    const struct viewer_settings s = settings_of(map, 2), t = settings_of(NULL, 2);
    g_autofree float *a = view_fixture_linear(through, &s, 200, 150);
    g_autofree float *b = view_fixture_linear(laid, &t, 200, 150);
    /* Rounding may choose the other of two texels at an edge. */
    g_assert_cmpint(count_different(a, b, 200 * 150, LOW), <, 4 * 200 * 150 / 500);
    /* The map has an effect, and none any more once it is taken away. */
    g_assert_true(viewer_set_index(through, NULL, &error));
    g_autofree float *c = view_fixture_linear(through, &s, 200, 150);
    g_assert_cmpint(count_different(a, c, 200 * 150, 0.05F), >, 200 * 150 / 10);
    eigenmaps_free(sample);
    eigenmaps_free(whole);
}

static struct lobes *new_lobes(int width, int height, const float *values) {
    struct lobes *p = g_new0(struct lobes, 1);
    *p = (struct lobes){.model = LOBES_PTM,
                        .name = g_strdup("test"),
                        .layout.width = (gsize)width,
                        .layout.height = (gsize)height,
                        .layout.texel_mm = 1,
                        .layout.views.n = RINGS * A_RING,
                        .layout.lights.n = RINGS * A_RING,
                        .n_slices = RINGS * A_RING,
                        .n_values = 9};
    rings_fill(0, &p->layout.views.theta_deg, &p->layout.views.phi_deg);
    rings_fill(5, &p->layout.lights.theta_deg, &p->layout.lights.phi_deg);
    p->values = g_memdup2(values, sizeof(float) * 9 * (gsize)(p->n_slices * width * height));
    return p;
}

static Viewer *new_lobes_view(struct lobes *lobes, const struct mesh *mesh) {
    g_autoptr(GError) error = NULL;
    gpointer material = ok(lobes_view_new(&lobes, 1, ERR));
    Viewer *view = viewer_new(NULL, &error);
    g_assert_true(viewer_set_method(view, &methods_lobes[LOBES_PTM], material, &error) &&
                  viewer_set_mesh(view, mesh, &error));
    lobes_free(lobes);
    return view;
}

/* Filtered between texels, a model whose values cannot be filtered: within, along and across
 * seams the same as what is laid out in full. */
GPU_TEST(filtered) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_plane();
    g_autoptr(IndexMap) map = new_map(W, H);
    const int n_slices = RINGS * A_RING;
    g_autofree float *values = g_new(float, 9 * (gsize)n_slices * W * H);
    g_autofree float *all = g_new(float, 9 * (gsize)n_slices * MAP_W * MAP_H);
    GRand *random = g_rand_new_with_seed(3);
    for (int k = 0; k < 9 * n_slices * W * H; k++)
        values[k] = (float)g_rand_double_range(random, 0.1, 0.5);
    g_rand_free(random);
    for (int slice = 0; slice < n_slices; slice++) {
        g_autofree float *one = laid_out(values + 9 * (gsize)slice * W * H, map, 9);
        memcpy(all + 9 * (gsize)slice * MAP_W * MAP_H, one, sizeof(float) * 9 * MAP_W * MAP_H);
    }
    g_autoptr(Viewer) through = new_lobes_view(new_lobes(W, H, values), mesh);
    g_autoptr(Viewer) laid = new_lobes_view(new_lobes(MAP_W, MAP_H, all), mesh);
    g_assert_true(viewer_set_index(through, map, &error));
    struct viewer_settings s = settings_of(map, 1.5), t = settings_of(NULL, 1.5);
    s.style.nearest = t.style.nearest = FALSE;
    g_autofree float *a = view_fixture_linear(through, &s, 240, 180);
    g_autofree float *b = view_fixture_linear(laid, &t, 240, 180);
    g_assert_cmpint(count_different(a, b, 240 * 180, LOW), ==, 0);
}

static struct mdf_table *new_relief(int width, int height) {
    static const float theta_deg[4] = {0, 45, 45, 45}, phi_deg[4] = {0, 0, 120, 240};
    struct mdf_table *table = mdf_table_new(width, height, 4, 1, theta_deg, phi_deg);
    GRand *random = g_rand_new_with_seed(9);
    for (int i = 0; i < 4 * width * height; i++)
        table->depth_mm[i] = (float)g_rand_double_range(random, 0, 0.6);
    table->deepest_mm = 0.6;
    g_rand_free(random);
    return table;
}

/* Silhouettes and shadows are those of the depths where the map puts them. */
GPU_TEST(relief) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 64, 32);
    g_autoptr(IndexMap) map = new_map(W, H);
    g_autoptr(MdfTable) sample = new_relief(W, H),
                        whole =
                            mdf_table_new(MAP_W, MAP_H, 4, 1, sample->theta_deg, sample->phi_deg);
    whole->deepest_mm = sample->deepest_mm;
    for (gsize view = 0; view < 4; view++) {
        g_autofree float *one = laid_out(sample->depth_mm + view * W * H, map, 1);
        memcpy(whole->depth_mm + view * MAP_W * MAP_H, one, sizeof(float) * MAP_W * MAP_H);
    }
    g_autoptr(Viewer) through = silhouettes_view(mesh, sample),
                      laid = silhouettes_view(mesh, whole);
    struct viewer_settings s = settings_of(map, 2), t = settings_of(NULL, 2);
    s.silhouettes = t.silhouettes = s.shadows = t.shadows = TRUE;
    s.visibility.views = t.visibility.views = TRUE;
    s.shadow_size = t.shadow_size = 128;
    g_autofree float *c = view_fixture_linear(through, &s, 120, 90);
    for (int way = VISIBILITY_AUTO; way <= VISIBILITY_PEEL; way++) {
        s.visibility.way = t.visibility.way = (enum visibility_way)way;
        g_assert_true(viewer_set_index(through, map, &error));
        g_autofree float *a = view_fixture_linear(through, &s, 120, 90);
        g_autofree float *b = view_fixture_linear(laid, &t, 120, 90);
        g_test_message("%d pixels differ, of the sample repeated %d",
                       count_different(a, b, 120 * 90, 0.02F) / 3,
                       count_different(c, b, 120 * 90, 0.02F) / 3);
        g_assert_cmpint(count_different(a, b, 120 * 90, 0.02F), <,
                        count_different(c, b, 120 * 90, 0.02F) / 20);
    }
}

/* The reference on the CPU reads the same map. */
GPU_TEST(reference) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = view_fixture_write_btf(TEXEL, 8, 16);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    g_assert_no_error(error);
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 128, 64);
    g_autoptr(Viewer) view = view_fixture_view(TEXEL, 8, 16, mesh);
    g_autoptr(IndexMap) map = new_map(W, H), other = new_map(W + 1, H);
    const struct viewer_settings s = settings_of(map, 2);
    double relative = 1, without = 0;
    g_assert_true(viewer_set_index(view, map, &error));
    g_autofree float *drawn =
        ok(reference_render_scene_linear(&reference, 1, view, &s, 60, 45, &relative, ERR));
    g_assert_cmpfloat(relative, <, 0.02);
    g_autofree float *with = view_fixture_linear(view, &s, 60, 45);
    g_assert_true(viewer_set_index(view, NULL, &error));
    g_autofree float *plain =
        reference_render_scene_linear(&reference, 1, view, &s, 60, 45, &without, &error);
    g_assert_cmpint(count_different(plain, with, 60 * 45, 0.05F), >, 60 * 45 / 10);
    g_assert_true(viewer_set_index(view, other, &error));
    g_assert_null(reference_render_scene_linear(&reference, 1, view, &s, 60, 45, NULL, &error));
    g_assert_error(error, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT);
    remove_folder(dir);
}

/* A map's file of a sample of another size is refused with a sentence, and the one before stays. */
GPU_TEST(other_sample) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 16, 8);
    g_autoptr(Viewer) view = view_fixture_view(TEXEL, 8, 16, mesh);
    g_autoptr(IndexMap) map = new_map(W, H), other = new_map(W + 1, H);
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "index.exr", NULL);
    g_assert_true(index_map_write(path, other, &error));
    g_assert_false(viewer_open_index(view, path, &error));
    g_assert_error(error, GPU_ERROR, GPU_ERROR_FAILED);
    g_autofree char *sizes = g_strdup_printf(
        "for a sample of %d × %d texels, but the material has %d × %d", W + 1, H, W, H);
    g_assert_nonnull(strstr(error->message, sizes));
    g_assert_null(viewer_index(view));
    g_clear_error(&error);
    g_assert_true(index_map_write(path, map, &error));
    g_assert_true(ok(viewer_open_index(view, path, ERR)));
    g_assert_nonnull(viewer_index(view));
}

/* Tiles that the mesh has become those in which the map repeats. */
GPU_TEST(tiles) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Viewer) view = view_fixture_plane(TEXEL, 3, 8);
    g_autoptr(IndexMap) map = index_map_new(512, 256, 64, 64, 1, "quilting");
    double u = 8, v = 3;
    viewer_whole_tiles(view, &u, &v);
    g_assert_cmpfloat(u, ==, 8);
    g_assert_true(viewer_set_index(view, map, &error));
    viewer_whole_tiles(view, &u, &v);
    g_assert_cmpfloat(u, ==, 8);
    g_assert_cmpfloat(v, ==, 4);
    u = 8, v = 7;
    viewer_whole_tiles(view, &u, &v);
    g_assert_cmpfloat(u, ==, 8);
    g_assert_cmpfloat(v, ==, 8);
    g_assert_cmpint(viewer_memory(view).index, ==, 4 * 512 * 256);
}
