/* mesorig-trace: makes a picture of a scene with captured materials, by path tracing. */
#include "trace_output.h"

#include "base/output_file.h"
#include "base/program.h"
#include "scene/environment.h"
#include "shapes/scene_parts.h"

#include <gio/gio.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define MAX_LAMPS 64

static char *png_path, *exr_path, **materials, **reliefs, *environment_name, **lamps, *size;
static char *camera;
static gboolean json, evenly, force;
static double turn_deg, exposure_ev;
static int samples = 64, depth = 16, threads;
static gint64 seed = 1;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &png_path, "The picture, exposed", "FILE.png"},
    {"exr", 0, 0, G_OPTION_ARG_FILENAME, &exr_path, "The picture's radiance", "FILE.exr"},
    {"material", 0, 0, G_OPTION_ARG_FILENAME_ARRAY, &materials,
     "Replace the scene's material NAME by a captured one, which is a session or a compressed "
     "file; TILES is the number of its tiles in one unit of the texture coordinates, default 1",
     "NAME=PATH[,TILES]"},
    {"relief", 0, 0, G_OPTION_ARG_FILENAME_ARRAY, &reliefs,
     "Give the captured material NAME the outlines and shadows of its relief, from the distances "
     "(MDF) in its session or in a file",
     "NAME[=FILE.exr]"},
    {"environment", 0, 0, G_OPTION_ARG_FILENAME, &environment_name,
     "Light from all directions: studio, overcast, white, or a map as an EXR", "NAME|FILE.exr"},
    {"turn", 0, 0, G_OPTION_ARG_DOUBLE, &turn_deg,
     "Turn the environment about the vertical axis, counter-clockwise seen from above", "DEG"},
    {"lamp", 0, 0, G_OPTION_ARG_STRING_ARRAY, &lamps,
     "A lamp that is far away, with its angles from the zenith and from +x; the default brightness "
     "is 1",
     "THETA,PHI[,BRIGHTNESS]"},
    {"camera", 0, 0, G_OPTION_ARG_STRING, &camera,
     "A camera that sees the whole scene, instead of the camera of the file; the default field of "
     "view is 40",
     "AZIMUTH,ELEVATION[,FOV]"},
    {"size", 0, 0, G_OPTION_ARG_STRING, &size, "Size in pixels, default 640x480", "WxH"},
    {"samples", 0, 0, G_OPTION_ARG_INT, &samples, "Samples per pixel, default 64", "N"},
    {"depth", 0, 0, G_OPTION_ARG_INT, &depth, "Largest number of reflections, default 16", "N"},
    {"exposure", 0, 0, G_OPTION_ARG_DOUBLE, &exposure_ev, "Exposure of the PNG, default 0", "EV"},
    {"seed", 0, 0, G_OPTION_ARG_INT64, &seed,
     "Seed of the random numbers, default 1: the same seed gives the same picture", "N"},
    {"threads", 0, 0, G_OPTION_ARG_INT, &threads, "Number of threads, default: one per processor",
     "N"},
    {"even", 0, 0, G_OPTION_ARG_NONE, &evenly,
     "Draw directions evenly instead of in proportion to the reflectance, for comparing noise",
     NULL},
    {"force", 0, 0, G_OPTION_ARG_NONE, &force, "Replace an existing output of any kind", NULL},
    {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print the result as JSON", NULL},
    {NULL},
};

static volatile sig_atomic_t stopped;

static void on_signal(int number) {
    stopped = 1;
}

/* Cancels the work after a signal. If stderr is a terminal, shows the progress in a line that is
 * overwritten. */
static void trace_main_tell(const struct work_progress *progress, gpointer cancellable) {
    if (stopped)
        g_cancellable_cancel(cancellable);
    if (!isatty(STDERR_FILENO))
        return;
    g_printerr("\r%s: %d %%", progress->stage, 100 * progress->done / MAX(progress->total, 1));
    if (progress->left_s >= 0.0)
        g_printerr(", %.0f s left   ", progress->left_s);
    if (progress->done == progress->total)
        g_printerr("\r\033[K");
}

/* Parses numbers that are separated by commas, at least n_least and at most 3. Elements of ret for
 * which text has no number keep their values. */
static gboolean trace_main_numbers(const char *option, const char *text, int n_least, double ret[3],
                                   GError **error) {
    g_auto(GStrv) parts = g_strsplit(text, ",", -1);
    const int n = (int)g_strv_length(parts);
    gboolean good = n >= n_least && n <= 3;
    for (int k = 0; good && k < n; k++) {
        char *end;
        ret[k] = g_ascii_strtod(parts[k], &end);
        good = end != parts[k] && *end == '\0' && isfinite(ret[k]);
    }
    if (!good)
        g_set_error(error, TRACE_ERROR, TRACE_ERROR_SETTING,
                    "--%s %s: give %d to 3 numbers, separated by commas", option, text, n_least);
    return good;
}

static gboolean trace_main_fail(GError **error, const char *format, ...) G_GNUC_PRINTF(2, 3);
static gboolean trace_main_fail(GError **error, const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *text = g_strdup_vprintf(format, list);
    va_end(list);
    g_set_error_literal(error, TRACE_ERROR, TRACE_ERROR_SETTING, text);
    return FALSE;
}

static gboolean trace_main_set_material(TraceScene *scene, const char *text, GError **error) {
    struct scene_binding binding;
    const gboolean good =
        scene_binding_parse(text, &binding, error) &&
        trace_scene_set_material(scene, binding.name, binding.path, binding.tiles, error);
    scene_binding_clear(&binding);
    return good;
}

static gboolean trace_main_set_relief(TraceScene *scene, const char *text, GError **error) {
    g_auto(GStrv) parts = g_strsplit(text, "=", 2);
    if (*parts == NULL || **parts == '\0' || (parts[1] != NULL && *parts[1] == '\0'))
        return trace_main_fail(error, "--relief %s: give NAME or NAME=FILE.exr", text);
    return trace_scene_set_relief(scene, parts[0], parts[1], error);
}

static gboolean trace_main_is_environment(const char *name) {
    return g_strv_contains(environment_names, name) || g_file_test(name, G_FILE_TEST_EXISTS);
}

static gboolean trace_main_set_sky(TraceScene *scene, GError **error) {
    if (environment_name == NULL)
        return TRUE;
    struct environment *environment;
    if (g_str_equal(environment_name, "white")) {
        environment = g_new(struct environment, 1);
        *environment = (struct environment){2, 1, g_new(float, 6)};
        for (int k = 0; k < 6; k++)
            environment->rgb[k] = 1.0F;
    } else if (!trace_main_is_environment(environment_name)) {
        g_autofree char *names = g_strjoinv(", ", (char **)environment_names);
        return trace_main_fail(error,
                               "--environment=%s: there is no file of that name; choose from: "
                               "white, %s; or give FILE.exr, an EXR that is twice as wide as high",
                               environment_name, names);
    } else {
        environment = environment_open(environment_name, error);
    }
    if (environment == NULL)
        return FALSE;
    TraceSky *sky = trace_sky_new(environment, turn_deg);
    environment_free(environment);
    if (sky == NULL)
        return trace_main_fail(
            error, "%s: the environment map is black everywhere; choose another environment",
            environment_name);
    trace_scene_set_sky(scene, sky);
    return TRUE;
}

static gboolean trace_main_set_lamps(TraceScene *scene, GError **error) {
    for (char **lamp = lamps; lamp != NULL && *lamp != NULL; lamp++) {
        double numbers[3] = {0.0, 0.0, 1.0};
        if (!trace_main_numbers("lamp", *lamp, 2, numbers, error))
            return FALSE;
        if (!(numbers[2] >= 0.0) || numbers[0] < 0.0 || numbers[0] > 180.0)
            return trace_main_fail(
                error, "--lamp %s: THETA must be 0 to 180, and BRIGHTNESS must not be negative",
                *lamp);
        trace_scene_add_lamp(scene, numbers[0], numbers[1], numbers[2]);
    }
    if (scene->lamps->len > MAX_LAMPS)
        return trace_main_fail(error,
                               "the scene and --lamp together have %u lamps, but at most %d are "
                               "possible; leave some out",
                               scene->lamps->len, MAX_LAMPS);
    if (scene->lamps->len == 0 && scene->sky == NULL && scene->lit.n == 0)
        return trace_main_fail(error, "the scene has no light; give --environment or --lamp");
    return TRUE;
}

static gboolean trace_main_set_camera(TraceScene *scene, GError **error) {
    double numbers[3] = {0.0, 0.0, 40.0};
    if (camera == NULL)
        return TRUE;
    if (!trace_main_numbers("camera", camera, 2, numbers, error))
        return FALSE;
    if (fabs(numbers[1]) > 90.0 || !(numbers[2] >= 1.0 && numbers[2] <= 170.0))
        return trace_main_fail(error, "--camera %s: ELEVATION must be −90 to 90, and FOV 1 to 170",
                               camera);
    trace_scene_look(scene, numbers[0], numbers[1], numbers[2]);
    return TRUE;
}

static gboolean trace_main_options(struct trace_options *ret, GError **error) {
    *ret = trace_options_default;
    ret->samples = samples;
    ret->depth = depth;
    ret->seed = (guint64)seed;
    ret->drawing = evenly ? TRACE_DRAW_EVENLY : TRACE_DRAW_BY_IMPORTANCE;
    char end;
    if (size != NULL && sscanf(size, "%dx%d%c", &ret->width, &ret->height, &end) != 2)
        return trace_main_fail(error, "--size %s: give WIDTHxHEIGHT, such as 640x480", size);
    if (threads < 0 || threads > 1024)
        return trace_main_fail(error, "--threads: %d is out of range: 0 to 1024", threads);
    if (!isfinite(exposure_ev) || fabs(exposure_ev) > 50.0)
        return trace_main_fail(error, "--exposure: %g is out of range: −50 to 50", exposure_ev);
    return trace_options_check(ret, error);
}

static double trace_main_mean(const float *values, gsize n) {
    double sum = 0.0;
    for (gsize k = 0; k < n; k++)
        sum += (double)values[k];
    return sum / (double)n;
}

static void trace_main_say(const TraceScene *scene, const TracePicture *picture,
                           const struct trace_options *options, double seconds) {
    const gsize n = (gsize)picture->width * (gsize)picture->height;
    guint triangles = 0;
    for (guint k = 0; k < scene->gltf->parts->len; k++)
        triangles += ((const struct gltf_part *)scene->gltf->parts->pdata[k])->mesh->n_indices / 3;
    const double variance = trace_main_mean(picture->variance, n);
    if (json)
        g_print("{\"width\": %d, \"height\": %d, \"samples\": %d, \"triangles\": %u, "
                "\"seconds\": %.3f, \"mean_radiance\": %.6g, \"sample_variance\": %.6g}\n",
                picture->width, picture->height, options->samples, triangles, seconds,
                trace_main_mean(picture->rgb, 3 * n), variance);
    else
        g_print("%d × %d pixels, %d samples each, %u triangles: %.1f s; standard error of a "
                "pixel %.2g\n",
                picture->width, picture->height, options->samples, triangles, seconds,
                sqrt(variance / options->samples));
}

/* Warns about each surface that the picture does not show as the file describes it. Does not warn
 * about surfaces with a captured material, because it replaces the material of the file. */
static void trace_main_warn(const char *path, const TraceScene *scene) {
    for (guint k = 0; k < scene->surfaces->len; k++) {
        const struct trace_surface *surface =
            &g_array_index(scene->surfaces, struct trace_surface, k);
        if (surface->warning != NULL && surface->material == NULL)
            g_printerr("mesorig-trace: warning: %s: %s\n", path, surface->warning);
    }
}

/* Writes an EXR if options is not NULL, and a PNG otherwise. */
static gboolean trace_main_write(OutputFile *to, const TracePicture *picture,
                                 const struct trace_options *options, GError **error) {
    const char *path = output_file_path(to, error);
    if (path == NULL ||
        !output_file_end(to,
                         options != NULL ? trace_write_exr(picture, options, path, error)
                                         : trace_write_png(picture, exposure_ev, path, error),
                         error))
        return FALSE;
    output_file_say(to, "mesorig-trace");
    return TRUE;
}

static gboolean trace_main_run(const char *path, GError **error) {
    struct trace_options options;
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    const struct work work = {threads, trace_main_tell, cancellable, cancellable};
    const gint64 begun_us = g_get_monotonic_time();
    /* the outputs are checked before the rendering, which may take hours */
    g_autoptr(OutputFile) png = NULL, exr = NULL;
    if (!trace_main_options(&options, error) ||
        (png_path != NULL && !(png = output_file_new(png_path, "trace", force, error))) ||
        (exr_path != NULL && !(exr = output_file_new(exr_path, "trace", force, error))))
        return FALSE;
    g_autoptr(TraceScene) scene = trace_scene_read(path, error);
    if (scene == NULL)
        return FALSE;
    for (char **material = materials; material != NULL && *material != NULL; material++)
        if (!trace_main_set_material(scene, *material, error))
            return FALSE;
    for (char **relief = reliefs; relief != NULL && *relief != NULL; relief++)
        if (!trace_main_set_relief(scene, *relief, error))
            return FALSE;
    trace_main_warn(path, scene);
    if (!trace_main_set_sky(scene, error) || !trace_main_set_lamps(scene, error) ||
        !trace_main_set_camera(scene, error))
        return FALSE;
    g_autoptr(TracePicture) picture = trace_render(scene, &options, &work, error);
    if (picture == NULL || (exr != NULL && !trace_main_write(exr, picture, &options, error)) ||
        (png != NULL && !trace_main_write(png, picture, NULL, error)))
        return FALSE;
    trace_main_say(scene, picture, &options, (double)(g_get_monotonic_time() - begun_us) / 1e6);
    return TRUE;
}

static const struct command_line command_line = {
    .name = "mesorig-trace",
    .arguments = "SCENE.gltf -o FILE.png",
    .summary = "A picture of a glTF scene with captured materials and global illumination, by path "
               "tracing.",
    .options = entries,
    .min = 1,
    .max = 1,
};

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    program_parse(&command_line, &argc, &argv);
    if (png_path == NULL && exr_path == NULL)
        return program_usage(&command_line,
                             "no picture is named: give -o FILE.png, --exr FILE.exr or both");
    const struct sigaction stop = {.sa_handler = on_signal, .sa_flags = (int)SA_RESETHAND};
    sigaction(SIGINT, &stop, NULL);
    sigaction(SIGTERM, &stop, NULL);
    if (trace_main_run(argv[1], &error))
        return 0;
    if (g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
        g_printerr("\nmesorig-trace: interrupted; nothing was written\n");
        return 130;
    }
    g_printerr("mesorig-trace: %s\n", error->message);
    return g_error_matches(error, TRACE_ERROR, TRACE_ERROR_SETTING) ||
                   error->domain == G_OPTION_ERROR
               ? 2
               : 1;
}
