#include "settings.h"

#include "scene/environment.h"

#include <gio/gio.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#define AT(field) offsetof(struct viewer_options, field)
#define OTHER(option, label)                                                                       \
    { option, label, SETTING_OTHER, 0, 0.0, 0.0, NULL, NULL, NULL }
#define FLAG(option, label, field, help)                                                           \
    { option, label, SETTING_FLAG, AT(field), 0.0, 1.0, NULL, NULL, help }

const struct setting settings_table[SETTINGS] = {
    [SETTING_METHOD] = OTHER("method", "method"),
    [SETTING_SPLIT] = OTHER("split", "compare"),
    [SETTING_SPLIT_AT] = {"split-at", "at", SETTING_NUMBER, AT(compose.at), 0.0, 1.0, "%.2f",
                          "SHARE",
                          "With --split: position of the border, 0 (left) … 1, default 0.5"},
    [SETTING_DIFFERENCE] = OTHER("difference", "with"),
    [SETTING_DIFFERENCE_GAIN] = {"difference-gain", "times", SETTING_NUMBER, AT(compose.gain), 1.0,
                                 32.0, "%.0f", "FACTOR",
                                 "With --difference: factor of amplification, default 4"},
    [SETTING_ROTATION] = OTHER("rotation", "microfacets turn"),
    [SETTING_PLAIN] = FLAG("plain", "one texture × cosine", settings.plain,
                           "Draws one texture times n·l instead of the BTF, for comparison"),
    [SETTING_NEAREST] = FLAG("nearest", "texels not filtered", settings.style.nearest,
                             "Do not filter between texels"),
    [SETTING_SHAPE] = OTHER("shape", "shape"),
    [SETTING_TILES] = OTHER("tiles", "tiles"),
    [SETTING_ENDLESS] = FLAG(
        "endless", "endless", settings.endless,
        "Continues the sample endlessly in hexagons, without repetition; for irregular materials"),
    [SETTING_SILHOUETTES] = OTHER("silhouettes", "silhouettes"),
    [SETTING_SHADOWS] =
        FLAG("shadows", "shadows", settings.shadows, "With the shadows that the shape casts"),
    [SETTING_FLOOR] = FLAG("floor", NULL, floor, "A floor of the material under the shape"),
    [SETTING_LAYERS] = {"layers", NULL, SETTING_WHOLE, AT(settings.visibility.layers), 1.0, 32.0,
                        "%.0f", "N",
                        "Largest number of silhouettes behind each other, 1 … 32 (default)"},
    [SETTING_STRAIGHT] =
        FLAG("straight", NULL, settings.visibility.straight,
             "Silhouettes as if the shape were flat under each ray, for comparison"),
    [SETTING_MDF_VOLUME] = FLAG("mdf-volume", NULL, settings.visibility.volume,
                                "Distances with 8 bits in a 3D texture, for comparison"),
    [SETTING_MDF_VIEWS] = FLAG("mdf-views", NULL, settings.visibility.views,
                               "Distances mixed from the nearest views, without overhangs, for "
                               "comparison"),
    [SETTING_ALONG_SURFACE] =
        FLAG("along-surface", "views along the surface", settings.along_surface,
             "With --silhouettes, or --reference of a session: views move along the surface of the "
             "MDF before they are mixed"),
    [SETTING_SHADOW_MAP] = {"shadow-map", NULL, SETTING_WHOLE, AT(settings.shadow_size), 16.0,
                            16384.0, "%.0f", "PIXELS",
                            "Size of the shadow map of the first lamp, 16 … 16384, default 1024"},
    [SETTING_LIGHT_SIZE] = {"light-size-deg", "size", SETTING_NUMBER, AT(settings.light_size_deg),
                            0.0, 60.0, "%.1f°", "DEG",
                            "With --shadows: angle that the light covers in the sky, which makes "
                            "the edges of its shadows soft; default 0"},
    [SETTING_LIGHT_THETA] = {"light-theta-deg", "θ", SETTING_NUMBER, AT(settings.light_theta_deg),
                             0.0, 180.0, "%.0f°", "DEG",
                             "Polar angle of the light, 0 (straight above) … 180, default 50"},
    [SETTING_LIGHT_PHI] = {"light-phi-deg", "φ", SETTING_NUMBER, AT(settings.light_phi_deg), 0.0,
                           360.0, "%.0f°", "DEG",
                           "Azimuth of the light from +x, default 200: from the left"},
    [SETTING_LIGHT_BRIGHTNESS] = {"light-brightness", "brightness", SETTING_NUMBER,
                                  AT(settings.lamp), 0.0, 4.0, "%.2f", "FACTOR",
                                  "Brightness of the light, default 1, or 0 with --environment"},
    [SETTING_LIGHT_DISTANCE] = {"light-distance", "distance", SETTING_NUMBER,
                                AT(settings.light_distance), 0.0, 10.0, "%.2f", "R",
                                "Distance of the light from the middle of the shape, in radii of "
                                "the shape; default 0: infinitely far away"},
    [SETTING_LIGHT_CONE] =
        {"light-cone-deg", "cone", SETTING_NUMBER, AT(settings.light_cone_deg), 0.0, 90.0, "%.0f°",
         "DEG",
         "With --light-distance: a spot light towards the middle of the shape, with this angle "
         "between its axis and its edge; default 0: light in all directions"},
    [SETTING_LIGHT_INNER] =
        {"light-inner-deg", "full within", SETTING_NUMBER, AT(settings.light_inner_deg), 0.0, 90.0,
         "%.0f°", "DEG",
         "With --light-cone-deg: angle from the axis up to which the spot light has full strength; "
         "it decreases from there to the edge; default 0"},
    [SETTING_LAMP] = OTHER("lamp", "lamp"),
    [SETTING_ENVIRONMENT] = OTHER("environment", "environment"),
    [SETTING_ENVIRONMENT_TURN] = {"environment-turn-deg", "turned by", SETTING_NUMBER,
                                  AT(settings.environment_turn_deg), 0.0, 360.0, "%.0f°", "DEG",
                                  "Turns the environment about the vertical axis"},
    [SETTING_ENVIRONMENT_LAMPS] =
        {"environment-lamps", "lamps of it", SETTING_WHOLE, AT(settings.environment_lamps),
         1.0, VIEWER_MAX_LAMPS, "%.0f", "N",
         "Number of lamps that represent the environment, 1 … 64 (default), in the window 16"},
    [SETTING_BACKDROP] = FLAG("backdrop", "seen behind the shape", settings.backdrop,
                              "Shows the environment behind the shape"),
    [SETTING_AMBIENT] = {"ambient", "ambient", SETTING_NUMBER, AT(settings.ambient), 0.0, 1.0,
                         "%.2f", "SHARE",
                         "Light from all directions, as a share of the lamp's light, default 0.05, "
                         "or 0 with --environment"},
    [SETTING_EXPOSURE] =
        {"exposure", "exposure", SETTING_NUMBER, AT(settings.exposure_ev), -6.0, 6.0, "%+.2f EV",
         "EV", "Exposure in stops, default 0.7; at 0 a lit white diffuser is just below white"},
    [SETTING_CAMERA_AZIMUTH] = {"camera-azimuth-deg", "azimuth", SETTING_NUMBER,
                                AT(settings.camera_azimuth_deg), -180.0, 180.0, "%.0f°", "DEG",
                                "Azimuth of the camera from +x, default -90: in front"},
    [SETTING_CAMERA_ELEVATION] =
        {"camera-elevation-deg", "elevation", SETTING_NUMBER, AT(settings.camera_elevation_deg),
         -90.0, 90.0, "%.0f°", "DEG",
         "Elevation of the camera above the horizon, -90 … 90, default 40"},
    [SETTING_CAMERA_DISTANCE] =
        {"camera-distance", "distance", SETTING_NUMBER, AT(settings.camera_distance), 0.05, 20.0,
         "%.2f", "R",
         "Distance of the camera in radii of the shape; default: the shape fills the picture"},
    [SETTING_CAMERA_PAN] = OTHER("camera-pan", "moved right, up"),
    [SETTING_CAMERA_FOV] = {"camera-fov-deg", "field of view", SETTING_NUMBER,
                            AT(settings.camera_fov_deg), 5.0, 90.0, "%.0f°", "DEG",
                            "Field of view of the shorter side, 1 … 120, default 30"},
    [SETTING_MEASURED] = OTHER("measured", "compare with the nearest frame"),
};

int settings_entries(struct viewer_options *o, GOptionEntry *ret) {
    static const GOptionArg arguments[] = {
        [SETTING_NUMBER] = G_OPTION_ARG_DOUBLE,
        [SETTING_WHOLE] = G_OPTION_ARG_INT,
        [SETTING_FLAG] = G_OPTION_ARG_NONE,
    };
    int n = 0;
    for (int k = 0; k < SETTINGS; k++) {
        const struct setting *s = &settings_table[k];
        if (s->kind != SETTING_OTHER)
            ret[n++] = (GOptionEntry){.long_name = s->option,
                                      .arg = arguments[s->kind],
                                      .arg_data = (char *)o + s->offset,
                                      .description = s->help,
                                      .arg_description = s->argument};
    }
    return n;
}

/* Adds " --NAME VALUE" to the command. The value is quoted if necessary. Takes ownership of value.
 * If value is NULL, adds only " --NAME". */
static void command_add(GString *command, const char *name, char *value) {
    g_string_append_printf(command, " --%s", name);
    const gboolean plain =
        value != NULL && *value != '\0' && *value != '-' &&
        strspn(value, "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789/._,+-") ==
            strlen(value);
    g_autofree char *quoted = value != NULL && !plain ? g_shell_quote(value) : NULL;
    if (value != NULL)
        g_string_append_printf(command, "%c%s", *value == '-' ? '=' : ' ', plain ? value : quoted);
    g_free(value);
}

static char *command_number(double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    return g_strdup(g_ascii_formatd(text, sizeof text, "%.10g", value));
}

/* Returns n numbers joined by a separator, such as "5x2" or "30,90,1,1,1". */
static char *command_numbers(const double *values, int n, const char *separator) {
    GString *text = g_string_new(NULL);
    for (int k = 0; k < n; k++) {
        g_autofree char *one = command_number(values[k]);
        g_string_append_printf(text, "%s%s", k > 0 ? separator : "", one);
    }
    return g_string_free(text, FALSE);
}

/* Returns the absolute path of a file, so that the command can be used in any folder. Text that is
 * not the path of an existing file, such as the name of a shape, is returned unchanged. */
static char *command_file(const char *path) {
    return g_file_test(path, G_FILE_TEST_EXISTS) ? g_canonicalize_filename(path, NULL)
                                                 : g_strdup(path);
}

static void command_table(GString *command, const struct viewer_options *o) {
    struct viewer_options usual;
    viewer_options_init(&usual);
    viewer_options_default_light(&usual.settings, o->environment != NULL);
    for (int k = 0; k < SETTINGS; k++) {
        const struct setting *s = &settings_table[k];
        if (o->environment == NULL &&
            (k == SETTING_ENVIRONMENT_LAMPS || k == SETTING_ENVIRONMENT_TURN))
            continue;
        const void *value = (const char *)o + s->offset, *other = (char *)&usual + s->offset;
        if (s->kind == SETTING_NUMBER && *(const double *)value != *(const double *)other)
            command_add(command, s->option, command_number(*(const double *)value));
        else if (s->kind == SETTING_WHOLE && *(const int *)value != *(const int *)other)
            command_add(command, s->option, command_number(*(const int *)value));
        else if (s->kind == SETTING_FLAG && *(const gboolean *)value)
            command_add(command, s->option, NULL);
    }
}

char *settings_command(const struct viewer_options *o, const struct settings_picture *picture) {
    static const char *const ways[] = {"auto", "peel", "lists"};
    const struct viewer_settings *s = &o->settings;
    GString *command = g_string_new("mesorig-view");
    if (o->argument != NULL) {
        g_autofree char *path = command_file(o->argument), *quoted = g_shell_quote(path);
        g_string_append_printf(command, " %s", quoted);
    }
    command_add(command, "render", g_strdup("picture.png"));
    command_add(command, "size", g_strdup_printf("%dx%d", picture->width, picture->height));
    command_add(command, "supersample", command_number(picture->samples));
    if (picture->live)
        command_add(command, "live", NULL);
    else
        command_add(command, "method", g_strdup(o->method->name));
    if (o->normal_map != NULL)
        command_add(command, "normal-map", command_file(o->normal_map));
    if (o->compose.mode != COMPOSE_ONE)
        command_add(command, o->compose.mode == COMPOSE_SPLIT ? "split" : "difference",
                    g_strdup(o->second->name));
    if (s->style.rotation != METHOD_ROTATION_EXACT)
        command_add(command, "rotation", g_strdup(method_rotation_names[s->style.rotation]));
    command_add(command, "shape", command_file(o->shape));
    for (int k = 0; k < o->n_bindings; k++) {
        const struct scene_binding *b = &o->bindings[k];
        g_autofree char *path = command_file(b->path), *tiles = command_number(b->tiles);
        command_add(command, "material", g_strdup_printf("%s=%s,%s", b->name, path, tiles));
    }
    if (o->upward == SCENE_Z_UP)
        command_add(command, "up", g_strdup("z"));
    command_add(command, "tiles",
                command_numbers((const double[]){s->tiles_u, s->tiles_v}, 2, "x"));
    if (s->silhouettes) {
        g_string_append_printf(command, " --silhouettes=%s", ways[s->visibility.way]);
        command_add(command, "mdf", command_file(o->mdf_path));
    }
    if (o->index_path != NULL)
        command_add(command, "index", command_file(o->index_path));
    for (int k = 0; k < picture->n_lamps; k++) {
        const struct viewer_lamp *l = &s->lamps[k];
        const double values[8] = {l->theta_deg,      l->phi_deg,        (double)l->rgb[0],
                                  (double)l->rgb[1], (double)l->rgb[2], l->distance,
                                  l->cone_deg,       l->inner_deg};
        const int n = l->distance == 0.0 ? 5 : l->cone_deg == 0.0 ? 6 : 8;
        command_add(command, "lamp", command_numbers(values, n, ","));
    }
    if (o->environment != NULL)
        command_add(command, "environment", command_file(o->environment));
    command_add(command, "camera-pan", command_numbers(s->camera_pan, 2, ","));
    command_table(command, o);
    return g_string_free(command, FALSE);
}
