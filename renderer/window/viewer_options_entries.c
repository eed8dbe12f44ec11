/* The entries of the command line: the rows of the table of settings, and options with separate
 * code. */
#include "drawing/methods/methods.h"
#include "settings.h"

#include <math.h>
#include <string.h>

static gboolean bad(GError **error, const char *option, const char *text, const char *wanted) {
    g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE, "%s %s: %s is expected", option,
                text, wanted);
    return FALSE;
}

/* data is the data of the option group: the options (see main()). */
static gboolean parse_silhouettes(const char *option, const char *value, gpointer data,
                                  GError **error) {
    static const char *const ways[] = {"auto", "peel", "lists"};
    struct viewer_options *o = data;
    o->settings.silhouettes = TRUE;
    for (gsize k = 0; k < G_N_ELEMENTS(ways); k++)
        if (value == NULL || strcmp(value, ways[k]) == 0) {
            o->settings.visibility.way = (enum visibility_way)k;
            return TRUE;
        }
    return bad(error, option, value, "auto, peel or lists");
}

static gboolean parse_rotation(const char *option, const char *value, gpointer data,
                               GError **error) {
    struct viewer_options *o = data;
    for (gsize k = 0; k < METHOD_ROTATIONS; k++)
        if (strcmp(value, method_rotation_names[k]) == 0) {
            o->settings.style.rotation = (enum method_rotation)k;
            return TRUE;
        }
    return bad(error, option, value, "exact, approximate or none");
}

/* Parses THETA,PHI[,R,G,B[,DISTANCE[,CONE[,INNER]]]]. */
static gboolean parse_lamp(const char *option, const char *value, gpointer data, GError **error) {
    struct viewer_options *o = data;
    struct viewer_settings *s = &o->settings;
    double numbers[8] = {0, 0, 1, 1, 1, 0, 0, 0};
    g_auto(GStrv) parts = g_strsplit(value, ",", -1);
    const guint n = g_strv_length(parts);
    if (s->n_lamps >= VIEWER_MAX_LAMPS) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "%s %s: at most %d lamps are possible; leave some out", option, value,
                    VIEWER_MAX_LAMPS);
        return FALSE;
    }
    gboolean good = n == 2 || (n >= 5 && n <= 8);
    for (guint k = 0; good && k < n; k++) {
        char *end;
        numbers[k] = g_ascii_strtod(parts[k], &end);
        good = end != parts[k] && *end == '\0' && fabs(numbers[k]) <= (k < 2 ? 1e6 : 1e3) &&
               (k == 1 || numbers[k] >= 0.0);
    }
    if (!good)
        return bad(error, option, value,
                   "THETA,PHI or THETA,PHI,R,G,B, optionally followed by DISTANCE, CONE, INNER,");
    s->lamps[s->n_lamps++] = (struct viewer_lamp){
        .theta_deg = numbers[0],
        .phi_deg = numbers[1],
        .rgb = {(float)numbers[2], (float)numbers[3], (float)numbers[4]},
        .distance = numbers[5],
        .cone_deg = numbers[6],
        .inner_deg = numbers[7],
    };
    return TRUE;
}

static gboolean parse_pan(const char *option, const char *value, gpointer data, GError **error) {
    struct viewer_options *o = data;
    double *pan = o->settings.camera_pan;
    char *end = NULL;
    pan[0] = g_ascii_strtod(value, &end);
    const gboolean two = end != value && *end == ',';
    const char *second = two ? end + 1 : value;
    pan[1] = g_ascii_strtod(second, &end);
    return (two && end != second && *end == '\0') || bad(error, option, value, "RIGHT,UP");
}

#define OPTION(name, kind, to, argument, text)                                                     \
    { name, 0, 0, G_OPTION_ARG_##kind, (gpointer)(to), text, argument }
#define FLAG(name, to, text) OPTION(name, NONE, to, NULL, text)

/* Returns the help of --method, which lists all methods. The text exists until the program ends. */
static const char *method_help(void) {
    static char *text;
    g_autoptr(GString) of_files = g_string_new(NULL), others = g_string_new(NULL);
    for (gsize k = 0; text == NULL && methods[k] != NULL; k++) {
        GString *list = methods[k]->product != NULL ? of_files : others;
        g_string_append_printf(list, "%s%s", list->len > 0 ? ", " : "", methods[k]->name);
    }
    if (text == NULL)
        text =
            g_strdup_printf("Drawing method: %s (default: that of the file; of a session, lpca if "
                            "“mesorig compress” made a local PCA, otherwise the first one for "
                            "which it has a product); without MATERIAL %s "
                            "(default: " METHOD_DEMO ")",
                            of_files->str, others->str);
    return text;
}

GOptionEntry *viewer_options_entries(struct viewer_options *o) {
    const GOptionEntry others[] = {
        {"render", 'o', 0, G_OPTION_ARG_FILENAME, &o->render,
         "Write a picture and do not open a window", "OUT.png"},
        FLAG("sample", &o->sample, "Show the sample material that comes with the package"),
        OPTION("shape", FILENAME, &o->shape, "SHAPE",
               "plane, torus (default), sphere, cylinder, torus-knot, an OBJ or a glTF file"),
        OPTION("material", FILENAME_ARRAY, &o->materials, "NAME=PATH[,TILES]",
               "With a glTF file as --shape: replaces its material NAME by this session or "
               "compressed file, with TILES tiles in one unit of the texture coordinates; may be "
               "repeated. Other materials are replaced by MATERIAL"),
        OPTION("method", STRING, &o->method_name, "METHOD", method_help()),
        OPTION("normal-map", FILENAME, &o->normal_map, "FILE",
               "Normals of metal-…, in tangent space with green upwards (PNG; or EXR, X Y Z)"),
        OPTION("rotation", CALLBACK, parse_rotation, "exact|approximate|none",
               "Rotation of microfacets with the normal (ward, ashikhmin, metal-…, fabric-…)"),
        OPTION("size", STRING, &o->size, "WxH",
               "Size in pixels, default 800x600, for the window 1200x800"),
        OPTION("tiles", STRING, &o->tiles, "N|UxV",
               "Repetitions of the material along the shape, for example 8x3"),
        OPTION("lamp", CALLBACK, parse_lamp, "THETA,PHI[,R,G,B[,DISTANCE[,CONE[,INNER]]]]",
               "A further lamp, with values as for --light-distance and the other options of the "
               "light; may be repeated"),
        OPTION("environment", FILENAME, &o->environment, "studio|overcast|FILE.exr",
               "Light from all directions instead of the lamp: computed, or a picture (EXR, zenith "
               "in its first row)"),
        OPTION("camera-pan", CALLBACK, parse_pan, "RIGHT,UP",
               "Moves the point at which the camera looks, in radii of the shape"),
        OPTION("supersample", INT, &o->supersample, "N",
               "Samples per pixel in each direction, 1 … 8; default 4, for the window 1, for a "
               "reference 2"),
        {"silhouettes", 0, G_OPTION_FLAG_OPTIONAL_ARG, G_OPTION_ARG_CALLBACK,
         (gpointer)parse_silhouettes,
         "Shows the outline of the structure, from the session's mdf.exr", "auto|peel|lists"},
        OPTION(
            "mdf", FILENAME, &o->mdf, "FILE",
            "File of distances for --silhouettes; default: mdf.exr in the folder of the material"),
        OPTION("index", FILENAME, &o->index, "FILE|DIR",
               "Arranges the texels by an index map of “mesorig synthesize”; also accepts a "
               "session that has an index map"),
        OPTION("up", STRING, &o->up, "y|z", "Upward axis of a shape's file, default y"),
        OPTION("frames", INT, &o->frames, "N", "With --render: number of pictures OUT_0000.png …"),
        OPTION("sheet", INT, &o->sheet, "COLUMNS",
               "With --frames: writes one picture with this number of frames side by side"),
        FLAG("reference", &o->reference,
             "With --render: draws the session's whole BTF instead of its eigen-maps, or draws a "
             "compressed file on the processor; slow"),
        OPTION("split", STRING, &o->split, "METHOD",
               "Draws the right half of the picture by another method"),
        OPTION("difference", STRING, &o->difference, "METHOD",
               "Shows the difference from another method, four times amplified around grey"),
        FLAG("measured", &o->measured,
             "With --render: shows the measured frame that is nearest to camera and light, the "
             "same view drawn, and four times their difference"),
        FLAG("live", &o->live,
             "Draws eigen-maps of the existing views while the session is still being captured"),
        OPTION("series", STRING, &o->series_text, "PERCENT,…",
               "With --live: writes a picture as soon as each of these shares of the views exists"),
        OPTION("wait-s", DOUBLE, &o->wait_s, "SECONDS",
               "With --series: longest time without a new view, default 600"),
        FLAG("light-turn", &o->light_turn, "The light goes once around during the frames"),
        FLAG("camera-turn", &o->camera_turn, "The camera goes once around during the frames"),
        OPTION("close-after", INT, &o->close_after, "N", "Close the window after this many frames"),
        OPTION("screenshot", FILENAME, &o->screenshot, "OUT.png",
               "Write the window's last picture when it closes"),
        FLAG("with-panel", &o->with_panel, "Screenshots show the window as it is, with its panel"),
        FLAG("force", &o->force, "Replace existing pictures of any kind"),
        FLAG("json", &o->json, "Print the result as JSON"),
        OPTION(G_OPTION_REMAINING, FILENAME_ARRAY, &o->rest, "MATERIAL", NULL),
    };
    GOptionEntry *all = g_new0(GOptionEntry, SETTINGS + G_N_ELEMENTS(others) + 1);
    memcpy(all, others, sizeof others);
    settings_entries(o, all + G_N_ELEMENTS(others));
    return all;
}
