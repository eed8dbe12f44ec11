/*
 * Measures how effects of real rigs change the results (docs/research/accuracy.md). For each effect
 * in the simulated world, a part of the demo's rig is calibrated from pictures of targets, a
 * session is captured and processed, and everything is compared with the truth. Each effect takes
 * one to two minutes of processor time.
 */
#include "bench.h"
#include "lib/process.h"
#include "lib/remove_tree.h"

#include <json-glib/json-glib.h>
#include <math.h>
#include <png.h>
#include <string.h>

#define DEMO     SOURCE_DIR "/etc/demo/"
#define BIN      BUILD_DIR "/bin/"
#define MAX_KEYS 2
#define SIDE     128 /* of the sample's pictures, px */

static const struct effect {
    const char *name, *section; /* the first word of the world's sections that have the keys */
    struct {
        const char *key, *value;
    } keys[MAX_KEYS];
    /* A capture pauses at a lamp that flickers from exposure to exposure of a bracket. All targets
     * are captured without the effect; then the tile once more, and the sample, with it and with
     * one exposure a shot. */
    gboolean one_exposure;
} effects[] = {
    {"none", "world", {{NULL}}},
    {"bent_sheet", "laser", {{"sheet_bend_mm", "0.1"}}},
    {"wobble", "world", {{"bearing_wobble_deg", "0.05"}, {"bearing_wobble_per_turn", "2"}}},
    {"glare", "camera", {{"veiling_glare", "0.005"}}},
    {"sensor", "camera", {{"half_gain_step", "0.01"}, {"column_offset", "0.001"}}},
    {"lateral_colour", "camera", {{"lateral_colour", "0.0005"}}},
    {"speckle", "world", {{"speckle_contrast", "0.3"}}},
    {"bleeding", "world", {{"bleeding_share", "0.3"}, {"bleeding_mm", "0.6"}}},
    {"flicker", "world", {{"lamp_flicker", "0.01"}}, TRUE},
};

static char *folder; /* of the effect */

static char *in_folder(const char *name) {
    return g_build_filename(folder, name, NULL);
}

static GKeyFile *read_conf(const char *name) {
    GKeyFile *file = g_key_file_new();
    g_autofree char *path = g_build_filename(DEMO, name, NULL);
    g_autoptr(GError) error = NULL;
    g_key_file_load_from_file(file, path, G_KEY_FILE_NONE, &error);
    bench_check(error);
    return file;
}

static void write_conf(GKeyFile *file, const char *name) {
    g_autofree char *path = in_folder(name);
    g_autoptr(GError) error = NULL;
    g_key_file_save_to_file(file, path, &error);
    bench_check(error);
}

/* Devices at 15, 45 and 60° are left. */
static GKeyFile *read_part(const char *name) {
    static const char *const others[] = {"camera cam30", "camera cam75",  "lamp lamp30",
                                         "lamp lamp75",  "laser laser30", "laser laser75",
                                         "axis sweep30", "axis sweep75"};
    GKeyFile *file = read_conf(name);
    for (gsize i = 0; i < G_N_ELEMENTS(others); i++)
        g_key_file_remove_group(file, others[i], NULL);
    return file;
}

static void number_lamps(GKeyFile *rig) {
    g_key_file_set_value(rig, "lamp lamp15", "index", "0");
    g_key_file_set_value(rig, "lamp lamp45", "index", "1");
    g_key_file_set_value(rig, "lamp lamp60", "index", "2");
}

static void write_rig(void) {
    g_autoptr(GKeyFile) rig = read_part("rig.conf");
    number_lamps(rig);
    write_conf(rig, "rig.conf");
}

static void write_png(png_uint_32 format, const guint16 *pixels, const char *name) {
    png_image image = {.version = PNG_IMAGE_VERSION, .width = SIDE, .height = SIDE};
    g_autofree char *path = in_folder(name);
    image.format = format;
    if (!png_image_write_to_file(&image, path, 0, pixels, 0, NULL))
        bench_fail(1, "%s: %s", path, image.message);
}

/* Waves, and patches of light and dark colours: smooth, so that what a texel holds is hardly an
 * error by itself. */
static void write_sample(GKeyFile *world) {
    g_autofree guint16 *height = g_new(guint16, SIDE * SIDE),
                       *albedo = g_new(guint16, SIDE * SIDE * 3);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const int column = i % SIDE, row = i / SIDE;
        const double x = 2 * G_PI * column / SIDE, y = 2 * G_PI * row / SIDE;
        height[i] = (guint16)(32767 * (1 + 0.5 * (sin(3 * x + y) + cos(4 * y - x))));
        for (int c = 0; c < 3; c++)
            albedo[3 * i + c] =
                (guint16)(65535 * (0.4 + 0.175 * (sin(2 * x - y + c) + cos(x + 2 * y + 2 * c))));
    }
    write_png(PNG_FORMAT_LINEAR_Y, height, "height.png");
    write_png(PNG_FORMAT_LINEAR_RGB, albedo, "albedo.png");
    g_key_file_set_value(world, "sample", "kind", "picture");
    g_key_file_set_value(world, "sample", "path", "height.png");
    g_key_file_set_value(world, "sample", "albedo_path", "albedo.png");
}

/* effect: NULL for none. */
static GKeyFile *new_world(const struct effect *effect) {
    GKeyFile *world = read_part("world.conf");
    g_auto(GStrv) groups = g_key_file_get_groups(world, NULL);
    g_key_file_set_value(world, "world", "gather_rays", "4");
    for (char **group = groups; *group; group++)
        for (int i = 0; effect && i < MAX_KEYS && effect->keys[i].key; i++)
            if (strncmp(*group, effect->section, strlen(effect->section)) == 0)
                g_key_file_set_value(world, *group, effect->keys[i].key, effect->keys[i].value);
    return world;
}

static void write_world(const struct effect *effect) {
    g_autoptr(GKeyFile) world = new_world(effect);
    write_sample(world);
    write_conf(world, "world.conf");
}

/* The tile of etc/demo/calibrate, in a folder of its own. */
static void write_tile(const struct effect *effect) {
    static const char *const sample[][2] = {{"kind", "flat"},
                                            {"width_mm", "60"},
                                            {"height_mm", "60"},
                                            {"base_mm", "2.2"},
                                            {"albedo", "0.96"}};
    g_autoptr(GKeyFile) world = new_world(effect), rig = read_part("rig.conf");
    g_autofree char *tile = in_folder("tile");
    g_key_file_remove_group(world, "sample", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(sample); i++)
        g_key_file_set_value(world, "sample", sample[i][0], sample[i][1]);
    g_mkdir_with_parents(tile, 0755);
    write_conf(world, "tile/world.conf");
    number_lamps(rig);
    write_conf(rig, "tile/rig.conf");
}

static void write_session(const char *name, const char *views, const char *lights,
                          const char *lasers, const char *texels) {
    g_autoptr(GKeyFile) file = read_conf(name);
    const struct {
        const char *section, *rings;
    } rings[] = {{"views", views}, {"lights", lights}, {"lasers", lasers}};
    for (gsize i = 0; i < G_N_ELEMENTS(rings); i++)
        if (rings[i].rings) {
            g_key_file_remove_key(file, rings[i].section, "preset", NULL);
            g_key_file_set_value(file, rings[i].section, "rings", rings[i].rings);
        }
    if (lasers) {
        g_key_file_set_value(file, "capture", "sweep_steps", "64");
        g_key_file_set_value(file, "capture", "on_blocked", "skip");
    }
    g_key_file_set_value(file, "sample", "texels", texels);
    write_conf(file, name);
}

static void copy(const char *name) {
    g_autofree char *from = g_build_filename(DEMO, name, NULL), *to = in_folder(name), *text = NULL;
    gsize length;
    g_autoptr(GError) error = NULL;
    if (g_file_get_contents(from, &text, &length, &error))
        g_file_set_contents(to, text, (gssize)length, &error);
    bench_check(error);
}

/* Of a session file that is there. */
static void set_exposure(const char *name, const char *exposure_us) {
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autofree char *path = in_folder(name);
    g_autoptr(GError) error = NULL;
    g_key_file_load_from_file(file, path, G_KEY_FILE_NONE, &error);
    bench_check(error);
    g_key_file_set_value(file, "capture", "exposures_us", exposure_us);
    write_conf(file, name);
}

static void write_files(const struct effect *effect) {
    write_rig();
    write_world(effect->one_exposure ? NULL : effect);
    copy("calibrate");
    copy("poles.conf");
    write_session("board.conf", "15:12; 45:12; 60:12", NULL, NULL, "8");
    write_session("lights.conf", "15:4; 45:4; 60:4", "15:2; 45:2; 60:2", NULL, "8");
    write_session("plate.conf", "15:1; 45:1; 60:1", NULL, "15:3; 45:3; 60:3", "8");
    write_session("tile.conf", "15:2; 45:2; 60:2", "15:2; 45:2; 60:2", NULL, "8");
    write_session("session.conf", "15:3; 45:3; 60:3", "15:3; 45:3; 60:3", "15:3; 45:3; 60:3", "24");
}

/* Adds the lines that warn, each once. */
static void note_warnings(const char *text, GPtrArray *warnings) {
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
    for (char **line = lines; *line; line++)
        if (strstr(*line, "warning") &&
            !g_ptr_array_find_with_equal_func(warnings, *line, g_str_equal, NULL))
            g_ptr_array_add(warnings, g_strdup(*line));
}

/* FALSE: the program has failed; ret_refused is then the last line with a reason. */
static gboolean step(const char *const *argv, GPtrArray *warnings, char **ret_refused) {
    g_autofree char *out = NULL, *err = NULL;
    const int code = process_run(argv, &out, &err);
    note_warnings(out, warnings);
    note_warnings(err, warnings);
    if (code == 0)
        return TRUE;
    g_auto(GStrv) lines = g_strsplit(g_strchomp(err), "\n", -1);
    for (char **line = lines; *line; line++)
        if (!*ret_refused || g_str_has_prefix(*line, "mesorig: ")) {
            g_free(*ret_refused);
            *ret_refused = g_strdup(*line);
        }
    return FALSE;
}

#define STEP(...) step((const char *const[]){__VA_ARGS__, NULL}, warnings, ret_refused)

/* The radiometry once more, from a tile with the effect; then the effect is in the world. */
static gboolean calibrate_again(const struct effect *effect, const char *calibration,
                                GPtrArray *warnings, char **ret_refused) {
    g_autofree char *rig = in_folder("tile/rig.conf"), *conf = in_folder("tile.conf"),
                    *session = in_folder("tile.session");
    write_tile(effect);
    write_session("tile.conf", "15:4; 45:4; 60:4", "15:3; 45:3; 60:3", NULL, "8");
    set_exposure("tile.conf", "2000");
    if (!STEP(BIN "mesorig", "capture", rig, conf, "-o", session) ||
        !STEP(BIN "mesorig", "calibrate", "radiometry", session, "--reflectance", "0.96", "-c",
              calibration, "-o", calibration))
        return FALSE;
    write_world(effect);
    set_exposure("session.conf", "4000");
    return TRUE;
}

/* The report of demo_report; NULL: something has failed. */
static JsonNode *measure(const struct effect *effect, GPtrArray *warnings, char **ret_refused) {
    g_autofree char *calibrate = in_folder("calibrate"),
                    *calibration = in_folder("rig.calibration"), *targets = in_folder("targets"),
                    *rig = in_folder("rig.conf"), *conf = in_folder("session.conf"),
                    *session = in_folder("weave.session"), *world = in_folder("world.conf"),
                    *report = in_folder("report.json");
    g_autoptr(GError) error = NULL;
    g_autoptr(JsonParser) parser = json_parser_new();
    write_files(effect);
    if (!STEP("/bin/sh", calibrate, BUILD_DIR, calibration, targets) ||
        (effect->one_exposure && !calibrate_again(effect, calibration, warnings, ret_refused)) ||
        !STEP(BIN "mesorig", "capture", rig, conf, "-o", session, "-c", calibration) ||
        !STEP(BIN "mesorig", "process", session) || !STEP(BIN "mesorig", "check", session) ||
        !STEP(BIN "demo_report", session, world, report))
        return NULL;
    json_parser_load_from_file(parser, report, &error);
    bench_check(error);
    return json_parser_steal_root(parser);
}

static double figure(JsonNode *report, const char *path) {
    g_autoptr(GError) error = NULL;
    g_autoptr(JsonNode) found = json_path_query(path, report, &error);
    bench_check(error);
    JsonArray *array = json_node_get_array(found);
    if (json_array_get_length(array) == 0 || json_array_get_null_element(array, 0))
        bench_fail(1, "there is no %s in the report", path);
    return json_array_get_double_element(array, 0);
}

static const struct {
    const char *name, *path;
} figures[] = {
#define CALIBRATION(name)                                                                          \
    {name "_before", "$.calibration." name ".nominal"}, {                                          \
        name, "$.calibration." name ".calibrated"                                                  \
    }
    CALIBRATION("camera_points_rms_px"),
    CALIBRATION("lamp_direction_deg"),
    CALIBRATION("laser_sheet_mm"),
    CALIBRATION("light_median"),
#undef CALIBRATION
    {"mdf_rms_mm", "$.mdf_rms_mm"},
    {"mdf_beyond_3_sigma", "$.mdf_beyond_3_sigma"},
    {"mdf_chi2", "$.mdf_chi2"},
    {"btf_median", "$.btf_relative_error_median"},
    {"btf_p95", "$.btf_relative_error_p95"},
    {"btf_chi2", "$.btf_chi2"},
};

static void print(const struct effect *effect, JsonNode *report, const GPtrArray *warnings,
                  const char *refused) {
    bench_begin(effect->name);
    for (gsize i = 0; report && i < G_N_ELEMENTS(figures); i++)
        bench_put_double(figures[i].name, "", "%.6g", figure(report, figures[i].path));
    if (!report)
        bench_put("%s{refused}", refused);
    bench_begin_list("warnings");
    for (guint i = 0; i < warnings->len; i++)
        bench_row(NULL, "%s{warning}", (const char *)warnings->pdata[i]);
    bench_end();
    bench_end();
}

int main(int argc, char **argv) {
    char *only = NULL, *keep = NULL;
    const GOptionEntry entries[] = {
        {"effect", 0, 0, G_OPTION_ARG_STRING, &only, "Measure this effect alone", "NAME"},
        {"keep", 0, 0, G_OPTION_ARG_FILENAME, &keep, "Leave all files in this folder", "DIR"},
        {NULL},
    };
    gboolean found = FALSE;
    bench_parse(&argc, &argv, entries, NULL);
    g_autofree char *base = keep ? keep : g_dir_make_tmp("mesorig-effects-XXXXXX", NULL);
    bench_begin(NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(effects); i++) {
        if (only && !g_str_equal(only, effects[i].name))
            continue;
        g_autoptr(GPtrArray) warnings = g_ptr_array_new_with_free_func(g_free);
        g_autofree char *refused = NULL;
        found = TRUE;
        folder = g_build_filename(base, effects[i].name, NULL);
        remove_tree(folder);
        g_mkdir_with_parents(folder, 0755);
        g_autoptr(JsonNode) report = measure(&effects[i], warnings, &refused);
        print(&effects[i], report, warnings, refused);
        g_clear_pointer(&folder, g_free);
    }
    bench_end();
    if (!keep)
        remove_tree(base);
    g_free(only);
    if (!found)
        bench_fail(2, "there is no such effect");
    return 0;
}
