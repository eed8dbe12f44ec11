/*
 * Mip levels of analytic models: what is fitted and written, and pictures of a plane far away and
 * tilted, where a pixel sees many texels, against the mean of what each of them reflects. How much
 * a picture flickers is measured as it moves by parts of a pixel.
 */
#include "exr/exr.h"
#include "lib/lobes_scene.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <string.h>

#define PIXELS 64
#define FINE   5 /* samples of the reference, each way of a pixel */
#define SHIFTS 4 /* of a pixel */

/* Rough and glossy texels of many colours, next to each other. */
static struct btf_matrix *new_btf(void) {
    g_autoptr(GRand) random = g_rand_new_with_seed(4);
    struct btf_matrix *btf = rings_btf("chips");
    const int n = RINGS * A_RING;
    for (int texel = 0; texel < W * H; texel++) {
        const double grey = texel % 2 ? 0.05 : g_rand_double_range(random, 0.3, 0.9);
        const double gloss = g_rand_double_range(random, 0, 0.6);
        const struct vec3 normal = vec3_unit(vec3(g_rand_double_range(random, -0.4, 0.4),
                                                  g_rand_double_range(random, -0.4, 0.4), 1));
        for (int k = 0; k < n * n; k++) {
            const struct vec3 v = btf_fixture_direction(&btf->layout.views, k / n);
            const struct vec3 l = btf_fixture_direction(&btf->layout.lights, k % n);
            const double nl = fmax(vec3_dot(normal, l), 0);
            const double shine =
                gloss * nl * pow(fmax(vec3_dot(vec3_unit(vec3_add(v, l)), normal), 0), 12);
            for (int c = 0; c < 3; c++)
                btf->values[3 * ((gsize)texel * n * n + k) + c] =
                    (float)(grey * (1 - 0.2 * c) * nl + shine);
        }
    }
    return btf;
}

/* Of linear values, 0 in the fourth where a sample sees no plane. */
static float *reference(const struct scene *scene, Viewer *view, const struct viewer_settings *s) {
    const int size = PIXELS * FINE;
    float *given[3], *mean = g_new0(float, 4 * PIXELS * PIXELS);
    for (int k = 0; k < 3; k++) {
        given[k] = ok(viewer_render_geometry(view, s, (enum viewer_geometry)k, size, size, ERR));
    }
    for (int k = 0; k < size * size; k++) {
        float *to = mean + 4 * (k / size / FINE * PIXELS + k % size / FINE);
        double rgb[3];
        if (given[0][4 * k + 3] <= 0 ||
            !lobes_scene_expected(scene, given[0] + 4 * k, given[1] + 4 * k, given[2] + 4 * k, rgb))
            continue;
        for (int c = 0; c < 3; c++)
            to[c] += (float)(rgb[c] / (FINE * FINE));
        to[3] += 1.0F / (FINE * FINE);
    }
    for (int k = 0; k < 4 * PIXELS * PIXELS; k += 4)
        mean[k + 3] = mean[k + 3] > 0.999F ? 1 : 0;
    for (int k = 0; k < 3; k++)
        g_free(given[k]);
    return mean;
}

/* Pictures of a plane that moves by a quarter of a pixel from one to the next. */
static void take(float *ret[SHIFTS], const struct scene *scene, Viewer *view,
                 const struct viewer_settings *settings) {
    g_autoptr(GError) error = NULL;
    for (int k = 0; k < SHIFTS; k++) {
        struct viewer_settings s = *settings;
        const double pixel =
            2 * s.camera_distance * tan(0.5 * s.camera_fov_deg * G_PI / 180) / PIXELS;
        s.camera_pan[0] = s.camera_pan[1] = pixel * k / SHIFTS;
        ret[k] = scene != NULL ? reference(scene, view, &s)
                               : viewer_render_linear(view, &s, PIXELS, PIXELS, &error);
        g_assert_no_error(error);
    }
}

struct quality {
    double error;   /* RMS, relative to the reference's */
    double flicker; /* RMS of a pixel's error about its mean over the shifts, relative alike */
};

static struct quality judge(float *const shown[SHIFTS], float *const truth[SHIFTS]) {
    double off = 0, all = 0, change = 0;
    for (int k = 0; k < 4 * PIXELS * PIXELS; k++) {
        double mean = 0, sum = 0;
        gboolean whole = k % 4 < 3;
        for (int i = 0; whole && i < SHIFTS; i++) {
            whole = truth[i][k | 3] > 0 && shown[i][k | 3] > 0;
            mean += ((double)shown[i][k] - truth[i][k]) / SHIFTS;
        }
        for (int i = 0; whole && i < SHIFTS; i++) {
            off += pow((double)shown[i][k] - truth[i][k], 2);
            all += pow(truth[i][k], 2);
            sum += pow((double)shown[i][k] - truth[i][k] - mean, 2);
        }
        change += sum;
    }
    g_assert_cmpfloat(all, >, 0);
    return (struct quality){sqrt(off / all), sqrt(change / all)};
}

static void free_pictures(float *pictures[SHIFTS]) {
    for (int k = 0; k < SHIFTS; k++)
        g_free(pictures[k]);
}

/* most: of the error and the flicker without levels. */
static void check_far(enum lobes_model model, double tiles, double most) {
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = new_btf();
    const struct lobes_options options = {.model = model};
    struct lobes *levels[LOBES_MAX_LEVELS];
    const int n = ok(lobes_compute_levels(btf, &options, levels, ERR));
    struct mesh *mesh = scene_plane();
    struct viewer_settings settings;
    g_autoptr(Viewer) view = viewer_new(NULL, &error);
    g_autoptr(Directions) views = directions_new(
        btf->layout.views.theta_deg, btf->layout.views.phi_deg, btf->layout.views.n, &error);
    const struct scene scene = {.lobes = levels[0], .layout = &levels[0]->layout, .views = views};
    float *truth[SHIFTS], *plain[SHIFTS], *levelled[SHIFTS];
    formula_start_view(view, &settings, mesh);
    settings.camera_elevation_deg = 35;
    settings.ambient = 0;
    settings.tiles_u = settings.tiles_v = tiles;
    viewer_set_method(view, &methods_lobes[model], lobes_view_new(levels, 1, &error), &error);
    take(truth, &scene, view, &settings);
    take(plain, NULL, view, &settings);
    viewer_set_method(view, &methods_lobes[model], lobes_view_new(levels, n, &error), &error);
    take(levelled, NULL, view, &settings);
    const struct quality without = judge(plain, truth), with = judge(levelled, truth);
    g_test_message("%s, %g tiles: error %.4f without levels, %.4f with; flicker %.4f and %.4f",
                   lobes_model_name(model), tiles, without.error, with.error, without.flicker,
                   with.flicker);
    g_assert_cmpfloat(with.error, <, most * without.error);
    g_assert_cmpfloat(with.flicker, <, most * without.flicker);
    free_pictures(truth);
    free_pictures(plain);
    free_pictures(levelled);
    mesh_free(mesh);
    btf_matrix_free(btf);
    for (int k = 0; k < n; k++)
        lobes_free(levels[k]);
}

GPU_TEST(far) {
    check_far(LOBES_FIELDS, 16, 0.5);
    check_far(LOBES_PTM, 16, 0.5);
    check_far(LOBES_LAFORTUNE, 16, 0.5);
    check_far(LOBES_WARD, 16, 0.5);
    check_far(LOBES_WARD, 40, 0.25);
}

/* Each level is the model of the averaged BTF, and comes back from the file as it was. */
TEST(file) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lobes.exr", NULL);
    static const int widths[] = {7, 3, 1}, heights[] = {5, 2, 1};
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = new_btf();
    for (int model = 0; model < LOBES_MODELS; model++) {
        const struct lobes_options options = {.model = (enum lobes_model)model};
        struct lobes *levels[LOBES_MAX_LEVELS], *back[LOBES_MAX_LEVELS];
        g_assert_cmpint(lobes_compute_levels(btf, &options, levels, &error), ==, 3);
        g_assert_true(lobes_write_levels(path, levels, 3, &error));
        g_assert_cmpint(lobes_read_levels(path, back, &error), ==, 3);
        g_assert_no_error(error);
        struct btf_matrix *half = btf_matrix_halved(btf);
        struct lobes *of_half = lobes_compute(half, &options, &error);
        for (int k = 0; k < 3; k++) {
            const struct lobes *one = levels[k];
            const int n = one->n_slices * btf_layout_texels(&one->layout) * one->n_values;
            g_assert_cmpint(back[k]->layout.width, ==, widths[k]);
            g_assert_cmpint(back[k]->layout.height, ==, heights[k]);
            g_assert_cmpmem(back[k]->values, sizeof(float) * (gsize)n, one->values,
                            sizeof(float) * (gsize)n);
            if (k == 1)
                g_assert_cmpmem(of_half->values, sizeof(float) * (gsize)n, one->values,
                                sizeof(float) * (gsize)n);
        }
        struct lobes *first = ok(lobes_read(path, ERR));
        g_assert_cmpint(first->layout.width, ==, W);
        g_assert_true(first->error == levels[0]->error);
        lobes_free(first);
        lobes_free(of_half);
        btf_matrix_free(half);
        for (int k = 0; k < 3; k++) {
            lobes_free(levels[k]);
            lobes_free(back[k]);
        }
    }
    struct exr_file *file = exr_read(path, &error);
    g_ptr_array_remove(file->parts, exr_file_part(file, "mip2.roughness"));
    g_assert_true(exr_write(path, file, EXR_ZIP, FALSE, &error));
    exr_file_free(file);
    struct lobes *none[LOBES_MAX_LEVELS];
    g_assert_cmpint(lobes_read_levels(path, none, &error), ==, 0);
    g_assert_nonnull(strstr(error->message, "roughness"));
    btf_matrix_free(btf);
}

/* The file without one part, or without all parts that begin so. */
static void write_without(const char *path, const char *from, const char *prefix) {
    g_autoptr(GError) error = NULL;
    struct exr_file *file = ok(exr_read(from, ERR));
    for (guint k = file->parts->len; k-- > 0;) {
        const struct exr_part *part = file->parts->pdata[k];
        if (g_str_has_prefix(part->name, prefix))
            g_ptr_array_remove_index(file->parts, k);
    }
    g_assert_true(exr_write(path, file, EXR_ZIP, FALSE, &error));
    exr_file_free(file);
}

/* A level that lacks the part by which levels are counted is not the end of them. */
TEST(lacking) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *whole = g_build_filename(folder, "whole.exr", NULL);
    g_autofree char *path = g_build_filename(folder, "lobes.exr", NULL);
    static const char *const lacking[] = {"mip1.views", "mip2.views", "mip1."};
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = new_btf();
    const struct lobes_options options = {.model = LOBES_PTM};
    struct lobes *levels[LOBES_MAX_LEVELS], *back[LOBES_MAX_LEVELS];
    g_assert_cmpint(lobes_compute_levels(btf, &options, levels, &error), ==, 3);
    g_assert_true(lobes_write_levels(whole, levels, 3, &error));
    for (gsize k = 0; k < G_N_ELEMENTS(lacking); k++) {
        write_without(path, whole, lacking[k]);
        g_assert_cmpint(lobes_read_levels(path, back, &error), ==, 0);
        g_assert_error(error, EXR_ERROR, EXR_ERROR_MISSING);
        g_test_message("%s", error->message);
        g_assert_nonnull(strstr(error->message, path));
        g_assert_nonnull(strstr(error->message, lacking[k]));
        g_clear_error(&error);
    }
    write_without(path, whole, "mip2.");
    g_assert_cmpint(lobes_read_levels(path, back, &error), ==, 2);
    g_assert_no_error(error);
    for (int k = 0; k < 3; k++)
        lobes_free(levels[k]);
    for (int k = 0; k < 2; k++)
        lobes_free(back[k]);
    btf_matrix_free(btf);
}

/* A level that is not half of the one before, or of another model, is refused with a sentence. */
GPU_TEST(bad) {
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = new_btf();
    const struct lobes_options options = {.model = LOBES_PTM};
    struct lobes *levels[LOBES_MAX_LEVELS];
    g_assert_cmpint(lobes_compute_levels(btf, &options, levels, &error), ==, 3);
    struct lobes *const skipped[2] = {levels[0], levels[2]};
    g_assert_null(lobes_view_new(skipped, 2, &error));
    g_assert_nonnull(strstr(error->message, "mip level 1 (ptm, "));
    g_clear_error(&error);
    levels[2]->values[3] = NAN;
    g_assert_null(lobes_view_new(levels, 3, &error));
    g_assert_nonnull(strstr(error->message, "mip level 2: value number 3"));
    g_clear_error(&error);
    levels[1]->layout.views.phi_deg[2] += 1;
    g_assert_null(lobes_view_new(levels, 3, &error));
    g_assert_nonnull(strstr(error->message, "mip level 1"));
    for (int k = 0; k < 3; k++)
        lobes_free(levels[k]);
    btf_matrix_free(btf);
}
