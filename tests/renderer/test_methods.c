/* What the interface promises for every drawing method in the table. */
#include "base/direction.h"
#include "btf/direction_grid.h"
#include "codecs/codecs.h"
#include "drawing/gl/shaders.h"
#include "drawing/methods/methods.h"
#include "drawing/methods/neural_view.h"
#include "lib/formula_fixture.h"
#include "lib/material_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <mesorig/material.h>
#include <string.h>

#define SKY        16 /* directions of the sky in each of two dimensions */
#define SKY_PIXELS 23 /* one pixel in so many is compared under the sky */

TEST(table) {
    for (gsize k = 0; methods[k] != NULL; k++) {
        const struct method *method = methods[k];
        g_assert_true(method_find(method->name) == method);
        g_assert_true(method->title && method->shaders && method->open && method->free &&
                      method->bytes && method->bind);
        g_assert_true((method->product != NULL) == (method->made_by != NULL));
        g_assert_true((method->product != NULL) == (method->texels != NULL));
        g_assert_cmpuint(g_strv_length((char **)method->shaders), <=, METHOD_SHADERS);
    }
    g_assert_null(method_find("wavelets"));
}

static const char *find_source(const char *name) {
    for (const struct shader *shader = shaders; shader->name != NULL; shader++)
        if (strcmp(shader->name, name) == 0)
            return shader->source;
    g_error("renderer/shaders has no %s", name);
}

/* Where places of the sample jump from pixel to pixel, derivatives mean nothing. */
TEST(derivatives) {
    for (gsize k = 0; methods[k] != NULL; k++)
        for (const char *const *name = methods[k]->shaders; *name != NULL; name++) {
            const char *source = find_source(*name);
            if (g_regex_match_simple("\\btexture\\(", source, 0, 0))
                g_error("renderer/shaders/%s: texture() takes derivatives: PLACE_TEXTURE() reads "
                        "textures of texels, textureLod() reads tables",
                        *name);
            if (g_regex_match_simple("\\bdFd[xy]\\(", source, 0, 0))
                g_error("renderer/shaders/%s: PLACE_DX() and PLACE_DY() replace dFdx() and dFdy()",
                        *name);
        }
}

/* A file and the directions from which it is drawn. */
struct seen {
    const struct codec *codec;
    gconstpointer model;
    const struct btf_layout *layout;
    float *texel; /* all values of a texel */
    int view, light;
    /* Whether a picture has the value of the nearest texel, instead of the mean of four. A network
     * is not linear between texels: its pictures are compared at the centres of texels. */
    gboolean nearest;
};

/* Whether a place is compared. What a network reads around the centre of a texel repeats in a
 * picture, but is clamped by the codec. */
static gboolean is_compared(const struct seen *seen, const float *at) {
    const int size[] = {(int)seen->layout->width, (int)seen->layout->height};
    gboolean ret = TRUE;
    for (int k = 0; k < 2 && seen->nearest; k++) {
        const int texel = (int)floor(((double)at[k] - floor((double)at[k])) * size[k]);
        ret &= texel > 0 && texel < size[k] - 1;
    }
    return ret;
}

/* The values of the four texels around a point, each at least 0, filtered, or that of the nearest.
 * at: in tiles. */
static void expected(const struct seen *seen, const float *at, double ret[3]) {
    const int width = (int)seen->layout->width, height = (int)seen->layout->height;
    double x = (double)at[0] * width - 0.5, y = (double)at[1] * height - 0.5;
    x = seen->nearest ? round(x) : x;
    y = seen->nearest ? round(y) : y;
    const gsize pair = (gsize)seen->view * seen->layout->lights.n + (gsize)seen->light;
    memset(ret, 0, 3 * sizeof(double));
    for (int k = 0; k < 4; k++) {
        const int i = (int)floor(x) + k % 2, j = (int)floor(y) + k / 2;
        const double share = (1 - fabs(x - i)) * (1 - fabs(y - j));
        const int texel = (j % height + height) % height * width + (i % width + width) % width;
        seen->codec->reconstruct(seen->model, texel, seen->texel);
        for (gsize c = 0; c < 3; c++)
            ret[c] += share * fmax((double)seen->texel[pair * 3 + c], 0);
    }
}

static void compare(const struct seen *seen, Viewer *view, const struct viewer_settings *settings) {
    g_autofree float *shown = ok(viewer_render_linear(view, settings, SIZE, SIZE, ERR));
    g_autofree float *at =
        ok(viewer_render_geometry(view, settings, VIEWER_GEOMETRY_TEXEL, SIZE, SIZE, ERR));
    double worst = 0, sum = 0, brightest = 0;
    int n = 0;
    for (gsize k = 0; k < 4 * SIZE * SIZE; k += 4) {
        double want[3];
        if (shown[k + 3] <= 0 || !is_compared(seen, at + k))
            continue;
        expected(seen, at + k, want);
        for (gsize c = 0; c < 3; c++, n++) {
            const double off = fabs((double)shown[k + c] - want[c]);
            worst = fmax(worst, off);
            sum += off;
            brightest = fmax(brightest, want[c]);
        }
    }
    g_test_message("%s, view %d, light %d: brightest %.2f, error %.4f on average, at most %.4f",
                   seen->codec->name, seen->view, seen->light, brightest, sum / MAX(n, 1), worst);
    g_assert_cmpint(n, >, seen->nearest ? 300 : 500);
    g_assert_cmpfloat(brightest, >, 0.1);
    g_assert_cmpfloat(sum / n, <, 0.01);
    g_assert_cmpfloat(worst, <, 0.06);
}

/* Under an even sky alone: the integral of the material over the hemisphere, as the sum over lights
 * of equal solid angles. Methods differ from it by up to 18 %, because they take fewer lights, or
 * do not replace negative values by 0. */
static void compare_sky(const struct seen *seen, const char *path, Viewer *view,
                        const struct viewer_settings *settings) {
    g_autofree float *shown = ok(viewer_render_linear(view, settings, SIZE, SIZE, ERR));
    g_autofree float *at =
        ok(viewer_render_geometry(view, settings, VIEWER_GEOMETRY_TEXEL, SIZE, SIZE, ERR));
    mesorig_material *material = mesorig_material_open(path, NULL, NULL);
    const struct direction_list *views = &seen->layout->views;
    float eye[3];
    double worst = 0;
    int n = 0;
    g_assert_nonnull(material);
    direction_from_deg(views->theta_deg[seen->view], views->phi_deg[seen->view], eye);
    const gsize step = seen->nearest ? SKY_PIXELS / 3 : SKY_PIXELS;
    for (gsize k = 0; k < 4 * SIZE * SIZE; k += 4 * step) {
        double want[3] = {0};
        if (shown[k + 3] <= 0 || !is_compared(seen, at + k))
            continue;
        const int size[] = {(int)seen->layout->width, (int)seen->layout->height};
        float place[2];
        for (int c = 0; c < 2; c++)
            place[c] = seen->nearest ? (floorf(at[k + c] * size[c]) + 0.5F) / size[c] : at[k + c];
        for (int i = 0; i < SKY * SKY; i++) {
            const int column = i % SKY, row = i / SKY;
            float light[3], rgb[3];
            direction_grid_direction((column + 0.5) / SKY, (row + 0.5) / SKY, light);
            g_assert_cmpint(mesorig_material_evaluate(material, 1, place, eye, light, NULL, rgb),
                            ==, MESORIG_OK);
            for (gsize c = 0; c < 3; c++)
                want[c] += settings->ambient * (double)rgb[c] * 2 / (SKY * SKY);
        }
        for (gsize c = 0; c < 3; c++, n++)
            worst = fmax(worst, fabs((double)shown[k + c] / want[c] - 1));
    }
    mesorig_material_close(material);
    g_test_message("%s, view %d, even sky: off by at most %.1f %%", seen->codec->name, seen->view,
                   100 * worst);
    g_assert_cmpint(n, >, 30);
    g_assert_cmpfloat(worst, <, 0.25);
}

/* Returns the codec whose files a method draws in the measured directions, or NULL. */
static const struct codec *codec_of(const struct method *method) {
    const gboolean volume = g_str_equal(method->name, "eigenmaps-volume");
    for (gsize k = 0; codecs[k] != NULL; k++)
        if (g_str_equal(codecs[k]->name, volume ? "eigenmaps" : method->name))
            return codecs[k];
    return NULL;
}

/* On a plane that is seen from a measured view under a measured light, each codec's method shows
 * what the codec reconstructs, and under an even sky its integral. The camera is so far away that
 * views differ by at most 0.3°. */
static void test_measured_directions(gconstpointer data) {
    const struct method *method = data;
    const struct codec *codec = codec_of(method);
    static const int pairs[][2] = {{0, 0}, {3, 5}, {10, 2}, {17, 12}};
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "x.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    g_autoptr(Mesh) mesh = scene_plane();
    g_autoptr(Viewer) view = ok(viewer_new(NULL, ERR));
    struct viewer_settings settings;
    material_fixture_write(path, codec, btf, "");
    gpointer model = ok(codec->read(path, ERR));
    struct seen seen = {codec, model, G_STRUCT_MEMBER_P(model, codec->layout)};
    const struct direction_list *views = &seen.layout->views, *lights = &seen.layout->lights;
    seen.texel = g_new(float, btf_layout_values(seen.layout));
    formula_start_view(view, &settings, mesh);
    ok(viewer_open(view, method, path, ERR));
    settings.ambient = 0;
    settings.camera_fov_deg = 1;
    settings.camera_distance = 300;
    settings.tiles_u = settings.tiles_v = 1;
    settings.style.nearest = seen.nearest = method == &method_neural;
    for (gsize k = 0; k < G_N_ELEMENTS(pairs); k++) {
        seen.view = pairs[k][0];
        seen.light = pairs[k][1];
        settings.camera_elevation_deg = 90 - (double)views->theta_deg[seen.view];
        settings.camera_azimuth_deg = (double)views->phi_deg[seen.view];
        settings.light_theta_deg = (double)lights->theta_deg[seen.light];
        settings.light_phi_deg = (double)lights->phi_deg[seen.light];
        compare(&seen, view, &settings);
        settings.ambient = 1;
        settings.lamp = 0;
        compare_sky(&seen, path, view, &settings);
        settings.ambient = 0;
        settings.lamp = 1;
    }
    g_free(seen.texel);
    codec->free(model);
}

/* Writes the eigen-maps of the small BTF, after one of its lights was moved along its ring. */
static char *write_eigenmaps(const char *folder, float move_deg) {
    char *path = g_build_filename(folder, "eigenmaps.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    const struct codec *codec = codec_of(method_find("eigenmaps"));
    btf->layout.lights.phi_deg[btf->layout.lights.n - 1] += move_deg;
    material_fixture_write(path, codec, btf, "");
    return path;
}

/* A 3D texture of the lights interpolates as the layers do: between two lights of a ring, between
 * two rings, and from the lowest ring towards the horizon. */
GPU_TEST(eigenmaps_volume) {
    static const double lights_deg[][2] = {{33, 50}, {66, 35}, {50, 31}, {80, 27}};
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = write_eigenmaps(folder, 0);
    g_autoptr(Mesh) mesh = scene_plane();
    g_autoptr(Viewer) layers = ok(viewer_new(NULL, ERR));
    g_autoptr(Viewer) volume = ok(viewer_new(NULL, ERR));
    struct viewer_settings settings;
    formula_start_view(layers, &settings, mesh);
    formula_start_view(volume, &settings, mesh);
    ok(viewer_open(layers, method_find("eigenmaps"), path, ERR));
    ok(viewer_open(volume, method_find("eigenmaps-volume"), path, ERR));
    settings.ambient = 0;
    settings.style.nearest = TRUE;
    for (gsize k = 0; k < G_N_ELEMENTS(lights_deg); k++) {
        settings.light_theta_deg = lights_deg[k][0];
        settings.light_phi_deg = lights_deg[k][1];
        g_autofree float *a = ok(viewer_render_linear(layers, &settings, SIZE, SIZE, ERR));
        g_autofree float *b = ok(viewer_render_linear(volume, &settings, SIZE, SIZE, ERR));
        double off = 0, brightest = 0;
        for (gsize i = 0; i < 4 * SIZE * SIZE; i++) {
            off = fmax(off, fabs((double)(a[i] - b[i])));
            brightest = fmax(brightest, i % 4 < 3 ? (double)a[i] : 0);
        }
        g_test_message("light at %g°, %g°: up to %.3f, the forms differ by at most %.4f",
                       lights_deg[k][0], lights_deg[k][1], brightest, off);
        g_assert_cmpfloat(brightest, >, 0.05);
        g_assert_cmpfloat(off, <, 0.005);
    }
}

GPU_TEST(volume_without_rings) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = write_eigenmaps(folder, 9);
    g_autoptr(Viewer) view = ok(viewer_new(NULL, ERR));
    g_autoptr(GError) error = NULL;
    g_assert_false(viewer_open(view, method_find("eigenmaps-volume"), path, &error));
    g_assert_nonnull(strstr(error->message, "use --method eigenmaps"));
    ok(viewer_open(view, method_find("eigenmaps"), path, ERR));
}

BEFORE_TESTS {
    for (gsize k = 0; methods[k] != NULL; k++) {
        g_autofree char *path =
            g_strdup_printf("/methods/measured-directions/%s", methods[k]->name);
        if (codec_of(methods[k]) != NULL)
            gpu_fixture_add(path, test_measured_directions, methods[k]);
    }
}
