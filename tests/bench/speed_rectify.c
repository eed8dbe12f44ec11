/* The object is a flat print that a formula describes, so that the mean of each texel is known. */
#include "speed_parts.h"

#include "exr/exr.h"
#include "frames/rectify.h"
#include "measurement_rig.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define TEXELS    128
#define TEXEL_MM  0.390625
#define LIGHTS    6
#define VIEW      2 /* from 45° */
#define TURNTABLE 0.4
#define FINE      4  /* rays a pixel, each way */
#define EXACT     12 /* points a texel, each way */
#define REPEATS   3

/* Radiance of a colour under a light: a pattern of three colours, and the edge of a shadow that
 * lies elsewhere for every light. */
static double radiance(double x, double y, int colour, int light) {
    const double pattern = 0.45 + 0.25 * sin(2.1 * x + colour) * cos(1.7 * y - 0.5 * colour) +
                           0.15 * sin(0.6 * (x + y) + 2 * colour);
    const double angle = 0.3 + light, across = x * cos(angle) + y * sin(angle);
    const double period = 9.0, at = across / period - floor(across / period);
    return pattern * (at < 0.5 ? 1 : 0.2) * (0.6 + 0.06 * light);
}

struct scene {
    struct rig_camera camera;
    struct session_grid grid;
    gsize n_pixels, n_texels;
    float *mosaics, *truth; /* of all lights */
};

/* Where the ray of a point of the picture meets the reference plane, in the sample frame. */
static struct vec3 hit(const struct scene *scene, double x_px, double y_px) {
    const struct vec3 eye = rig_camera_centre_mm(&scene->camera);
    const struct vec3 ray = rig_pixel_ray(&scene->camera, x_px, y_px);
    const double t = (scene->grid.reference_mm - eye.z) / ray.z;
    const struct vec3 p = {eye.x + t * ray.x, eye.y + t * ray.y, eye.z + t * ray.z};
    return rig_turn(p, -TURNTABLE);
}

static double vignetting(const struct rig_camera *camera, double x, double y) {
    const double corner = hypot(MAX(camera->cx_px, camera->width - 1 - camera->cx_px),
                                MAX(camera->cy_px, camera->height - 1 - camera->cy_px));
    const double r = hypot(x - camera->cx_px, y - camera->cy_px) / corner;
    return 1 - camera->vignetting * r * r;
}

static void expose(struct scene *scene) {
    const int width = scene->camera.width;
    for (gsize i = 0; i < scene->n_pixels; i++) {
        const int x = (int)(i % (gsize)width), y = (int)(i / (gsize)width);
        const int colour = (x & 1) + (y & 1); /* rggb */
        double sums[LIGHTS] = {0};
        for (int k = 0; k < FINE * FINE; k++) {
            const int column = k % FINE, row = k / FINE;
            const struct vec3 p =
                hit(scene, x + (column + 0.5) / FINE - 0.5, y + (row + 0.5) / FINE - 0.5);
            for (int light = 0; light < LIGHTS; light++)
                sums[light] += radiance(p.x, p.y, colour, light) / (FINE * FINE);
        }
        for (int light = 0; light < LIGHTS; light++)
            scene->mosaics[(gsize)light * scene->n_pixels + i] =
                (float)(sums[light] * vignetting(&scene->camera, x, y) * scene->camera.response *
                        1e-3);
    }
}

static struct scene *scene_new(void) {
    const struct bench_setup setup = {
        .material = "weave", .texels = TEXELS, .texel_mm = TEXEL_MM, .pixels_a_texel = 2};
    struct scene *scene = g_new0(struct scene, 1);
    struct rig *rig = g_new0(struct rig, 1);
    bench_rig(&setup, rig);
    scene->camera = rig->cameras[VIEW];
    g_free(rig);
    scene->grid = bench_grid(&setup);
    scene->n_pixels = (gsize)scene->camera.width * (gsize)scene->camera.height;
    scene->n_texels = (gsize)TEXELS * TEXELS;
    scene->mosaics = g_new(float, scene->n_pixels *LIGHTS);
    scene->truth = g_new(float, scene->n_texels * 3 * LIGHTS);
    expose(scene);
    for (gsize i = 0; i < scene->n_texels * LIGHTS; i++) {
        const int light = (int)(i / scene->n_texels), texel = (int)(i % scene->n_texels);
        for (int colour = 0; colour < 3; colour++) {
            double sum = 0;
            for (int k = 0; k < EXACT * EXACT; k++) {
                const int x = texel % TEXELS * EXACT + k % EXACT;
                const int y = texel / TEXELS * EXACT + k / EXACT;
                const double column = (x + 0.5) / EXACT, row = (y + 0.5) / EXACT;
                sum += radiance((column - TEXELS / 2.0) * TEXEL_MM, (TEXELS / 2.0 - row) * TEXEL_MM,
                                colour, light);
            }
            scene->truth[3 * i + (gsize)colour] = (float)(sum / (EXACT * EXACT));
        }
    }
    return scene;
}

static double since_ms(gint64 begun_us) {
    return (double)(speed_now_us() - begun_us) / 1e3;
}

/* As capture stores it. */
static double decode_ms(const struct scene *scene) {
    static const char *const channels[] = {"Y", NULL};
    struct exr_part *part =
        exr_part_new("radiance", scene->camera.width, scene->camera.height, channels, EXR_HALF);
    struct exr_file *file = exr_file_new();
    g_autofree char *path = NULL;
    memcpy(part->planes[0], scene->mosaics, sizeof(float) * scene->n_pixels);
    exr_file_add(file, part);
    close(g_file_open_tmp("bench-speed-XXXXXX.exr", &path, NULL));
    g_assert_true(exr_write(path, file, EXR_PIZ, FALSE, NULL));
    exr_file_free(file);
    double best = G_MAXDOUBLE;
    for (int i = 0; i < REPEATS * LIGHTS; i++) {
        const gint64 begun_us = speed_now_us();
        file = exr_read(path, NULL);
        best = MIN(best, since_ms(begun_us));
        exr_file_free(file);
    }
    g_unlink(path);
    return best;
}

static void rectify_all(const struct scene *scene, struct speed_rectify *ret) {
    g_autofree float *rgb = g_new(float, scene->n_texels * 3);
    g_autofree float *guide = g_new0(float, scene->n_pixels);
    for (gsize i = 0; i < scene->n_pixels * LIGHTS; i++)
        guide[i % scene->n_pixels] += scene->mosaics[i];
    const gint64 begun_us = speed_now_us();
    g_autoptr(Rectify) rectify =
        rectify_new(&scene->camera, NULL, "rggb", TURNTABLE, &scene->grid, NULL);
    rectify_guide(rectify, guide);
    ret->prepare_ms = since_ms(begun_us);
    ret->rectify_ms = G_MAXDOUBLE;
    double squares = 0, all = 0;
    for (int repeat = 0; repeat < REPEATS; repeat++)
        for (gsize light = 0; light < LIGHTS; light++) {
            const gint64 start_us = speed_now_us();
            rectify_apply(rectify, scene->mosaics + light * scene->n_pixels, rgb, NULL);
            ret->rectify_ms = MIN(ret->rectify_ms, since_ms(start_us));
            const float *truth = scene->truth + light * scene->n_texels * 3;
            for (gsize i = 0; i < scene->n_texels * 3; i++) {
                squares += pow((double)rgb[i] - (double)truth[i], 2);
                all += pow((double)truth[i], 2);
            }
        }
    ret->error = sqrt(squares / all);
}

static void add(GString *text, const char *name, const double *values, int n) {
    char number[G_ASCII_DTOSTR_BUF_SIZE];
    g_string_append_printf(text, "\"%s\": %s", name, n > 1 ? "[" : "");
    for (int i = 0; i < n; i++)
        g_string_append_printf(text, "%s%s", i ? ", " : "",
                               g_ascii_dtostr(number, sizeof number, values[i]));
    g_string_append(text, n > 1 ? "],\n" : ",\n");
}

static char *settings(const struct scene *scene, double wanted, const char *mosaics,
                      const char *truth) {
    const struct rig_camera *c = &scene->camera;
    const double matrix[] = {c->fx_px, 0, c->cx_px, 0, c->fy_px, c->cy_px, 0, 0, 1};
    const double distortion[] = {c->k1, c->k2, c->p1, c->p2, c->k3};
    const double translation[] = {c->translation_mm.x, c->translation_mm.y, c->translation_mm.z};
    const double centre[] = {c->cx_px, c->cy_px}, turntable = TURNTABLE, texel_mm = TEXEL_MM;
    const double corner =
        hypot(MAX(c->cx_px, c->width - 1 - c->cx_px), MAX(c->cy_px, c->height - 1 - c->cy_px));
    const double scale = 1e3 / c->response;
    g_autoptr(GString) text = g_string_new("{");
    add(text, "matrix", matrix, 9);
    add(text, "distortion", distortion, 5);
    add(text, "rotation", (const double *)&c->rotation, 9);
    add(text, "translation", translation, 3);
    add(text, "centre", centre, 2);
    add(text, "turntable_rad", &turntable, 1);
    add(text, "texel_mm", &texel_mm, 1);
    add(text, "reference_mm", &scene->grid.reference_mm, 1);
    add(text, "vignetting", &c->vignetting, 1);
    add(text, "corner", &corner, 1);
    add(text, "scale", &scale, 1);
    add(text, "wanted", &wanted, 1);
    g_string_append_printf(text,
                           "\"frames\": %d, \"width\": %d, \"height\": %d, \"texels\": %d,\n"
                           "\"mosaics\": \"%s\", \"truth\": \"%s\"}\n",
                           LIGHTS, c->width, c->height, TEXELS, mosaics, truth);
    return g_strdup(text->str);
}

static gboolean save(const char *path, const float *values, gsize n) {
    return g_file_set_contents_full(path, (const char *)values, (gssize)(n * sizeof *values),
                                    G_FILE_SET_CONTENTS_NONE, 0600, NULL);
}

static void run_opencv(const struct scene *scene, struct speed_rectify *ret) {
    g_autofree char *folder = g_dir_make_tmp("bench-speed-XXXXXX", NULL);
    g_autofree char *mosaics = g_build_filename(folder, "mosaics", NULL);
    g_autofree char *truth = g_build_filename(folder, "truth", NULL);
    g_autofree char *path = g_build_filename(folder, "settings.json", NULL), *out = NULL;
    g_autofree char *text = settings(scene, ret->error, mosaics, truth);
    const char *const arguments[] = {path, NULL};
    if (save(mosaics, scene->mosaics, scene->n_pixels * LIGHTS) &&
        save(truth, scene->truth, scene->n_texels * 3 * LIGHTS) &&
        g_file_set_contents(path, text, -1, NULL))
        out = speed_peer("rectify_opencv.py", arguments);
    ret->opencv_ms = speed_number(out, "ms");
    ret->opencv_error = speed_number(out, "error");
    ret->opencv_reaches = speed_number(out, "reached") > 0;
    g_unlink(mosaics);
    g_unlink(truth);
    g_unlink(path);
    g_rmdir(folder);
}

struct speed_rectify speed_rectify(void) {
    struct speed_rectify ret = {0};
    struct scene *scene = scene_new();
    ret.decode_ms = decode_ms(scene);
    rectify_all(scene, &ret);
    run_opencv(scene, &ret);
    g_free(scene->mosaics);
    g_free(scene->truth);
    g_free(scene);
    return ret;
}
