/* Noise of path tracing: how much importance sampling lowers the variance of a sample compared with
 * evenly distributed directions. This is measured for the light of an even sky that a material
 * reflects, and for pictures of a sphere of this material in the studio, with and without rays
 * towards the light. */
#include "bench.h"
#include "lib/material_fixture.h"
#include "lib/remove_tree.h"
#include "lib/trace_fixture.h"
#include "scene/environment_made.h"
#include "tracer/trace_path.h"

#include <math.h>

#define LIMIT  4.0 /* times less variance */
#define POINTS 64  /* texels, each with a view */

struct picture_noise {
    double variance, seconds, mean;
};

static const char *const ways[2] = {"importance", "even"};

/* A small BTF with a highlight, for those who give no material. */
static char *made_material(const char *folder) {
    char *path = g_build_filename(folder, "made.exr", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    material_fixture_write(path, codecs_find("eigenmaps"), btf, "");
    return path;
}

static TraceScene *bench_scene(const char *folder, const char *material, double tiles) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) sphere = scene_sphere();
    const struct trace_object object = {sphere, 0, 1.0F, {0, 0, 0}, FALSE};
    g_autofree char *text = trace_fixture_text(&object, 1, "{\"name\": \"sphere\"}", "", "", 0);
    g_autofree char *path = g_build_filename(folder, "scene.gltf", NULL);
    g_file_set_contents(path, text, -1, &error);
    bench_check(error);
    TraceScene *scene = trace_scene_read(path, &error);
    bench_check(error);
    trace_scene_set_material(scene, "sphere", material, tiles, &error);
    bench_check(error);
    struct environment *studio = environment_make("studio");
    trace_scene_set_sky(scene, trace_sky_new(studio, 0.0));
    environment_free(studio);
    return scene;
}

/* Variance of one sample of ∫ value dω / π, mean over texels and views up to 70°; in G. */
static double albedo_variance(const struct trace_surface *surface, enum trace_drawing drawing,
                              int n, double *ret_mean) {
    double variance = 0.0;
    *ret_mean = 0.0;
    for (int k = 0; k < POINTS; k++) {
        struct trace_random random = trace_random_new(7, (guint64)k, drawing);
        const double theta = 70.0 * G_PI / 180 * (k + 0.5) / POINTS, phi = 2.4 * k;
        const struct vec3 view = vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
        const struct trace_texel at = {fmod(0.618 * k, 1.0), fmod(0.7548 * k, 1.0)};
        double sum = 0.0, squares = 0.0;
        for (int i = 0; i < n; i++) {
            struct vec3 light;
            double rgb[3];
            const double p = trace_surface_draw(surface, at, view, drawing, &random, &light, rgb);
            const double one = p > 0.0 ? rgb[1] / p : 0.0;
            sum += one;
            squares += one * one;
        }
        variance += (squares / n - sum / n * sum / n) / POINTS;
        *ret_mean += sum / n / POINTS;
    }
    return variance;
}

static struct picture_noise picture_noise(const TraceScene *scene, int samples,
                                          enum trace_drawing drawing, gboolean lamps_too) {
    g_autoptr(GError) error = NULL;
    struct trace_options options = trace_options_default;
    const struct work work = {.n_threads = 1};
    options.width = options.height = 96;
    options.samples = samples;
    options.drawing = drawing;
    options.lamps_too = lamps_too;
    const double begun_s = bench_cpu_s();
    g_autoptr(TracePicture) picture = trace_render(scene, &options, &work, &error);
    bench_check(error);
    struct picture_noise ret = {0.0, bench_cpu_s() - begun_s, 0.0};
    for (int k = 0; k < 96 * 96; k++) {
        ret.variance += (double)picture->variance[k] / (96 * 96);
        ret.mean += (double)picture->rgb[3 * k + 1] / (96 * 96);
    }
    return ret;
}

static void tell_albedo(const double variance[2], const double mean[2]) {
    bench_row("albedo",
              "%.5f{importance_mean} %.5f{even_mean} %.6g{importance_variance} %.6g{even_variance} "
              "%.3f{ratio} %.1f{limit}",
              mean[0], mean[1], variance[0], variance[1], variance[1] / variance[0], LIMIT);
}

int main(int argc, char **argv) {
    int samples = 64;
    double tiles = 3.0;
    g_autofree char *given = NULL;
    const GOptionEntry entries[] = {
        {"material", 0, 0, G_OPTION_ARG_FILENAME, &given,
         "A session or a compressed material; default: a small one with a highlight", "PATH"},
        {"tiles", 0, 0, G_OPTION_ARG_DOUBLE, &tiles, "Around the sphere, default 3", "N"},
        {"samples", 0, 0, G_OPTION_ARG_INT, &samples, "Of each pixel, default 64", "N"},
        {NULL}};
    bench_parse(&argc, &argv, entries, NULL);
    if (samples < 2 || samples > 100000 || !(tiles > 0.0) || argc > 1)
        bench_fail(2, "bad arguments");
    g_autofree char *folder = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *material = given ? g_strdup(given) : made_material(folder);
    g_autoptr(TraceScene) scene = bench_scene(folder, material, tiles);
    remove_tree(folder);
    const struct trace_surface *surface = &g_array_index(scene->surfaces, struct trace_surface, 0);
    double variance[2], mean[2];
    for (int way = 0; way < 2; way++)
        variance[way] =
            albedo_variance(surface, (enum trace_drawing)way, 200 * samples, &mean[way]);
    bench_begin(NULL);
    tell_albedo(variance, mean);
    bench_begin_list("pictures");
    for (int lamps_too = 0; lamps_too < 2; lamps_too++) {
        struct picture_noise noise[2];
        for (int way = 0; way < 2; way++)
            noise[way] = picture_noise(scene, samples, (enum trace_drawing)way, lamps_too != 0);
        for (int way = 0; way < 2; way++) {
            bench_begin(NULL);
            bench_put_boolean("lights_looked_for", lamps_too != 0);
            bench_put("%s{directions} %.5f{mean} %.6g{variance} %.3f{cpu_s}", ways[way],
                      noise[way].mean, noise[way].variance, noise[way].seconds);
            bench_end();
        }
    }
    bench_end();
    bench_end();
    return variance[1] / variance[0] >= LIMIT ? 0 : 1;
}
