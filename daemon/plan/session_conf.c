#include "plan.h"

#include <string.h>

#define MAX_DIRECTIONS 1024
/* The position of a pixel's peak is kept in 15 bits, see frames/sweep.c. */
#define MAX_SWEEP_STEPS G_MAXINT16

static const struct {
    const char *name, *rings;
} presets[] = {
    {"12x5", "15:12; 30:12; 45:12; 60:12; 75:12"},
    {"12x8", "12:12; 21:12; 30:12; 39:12; 48:12; 57:12; 66:12; 75:12"},
    {"81", "0:1; 15:6; 30:12; 45:18; 60:20; 75:24"},
    {"26", "15:2; 30:6; 45:6; 60:6; 75:6"},
};

struct fields { /* the session, and what is checked before it becomes a part of it */
    struct session_conf conf;
    char *name;
    char *described, *operator_name, *notes, *license; /* read again by the archive */
    double flat_mm, flat_error_mm, flat_radius_mm;
    struct option_doubles flat_hole_mm;
    int texels, texels_x, texels_y;
    struct option_doubles exposures_us;
};

#define FIELD(member) G_STRUCT_OFFSET(struct fields, member)
#define CONF(member)  FIELD(conf.member)

static const struct option session_options[] = {
    {"name", OPTION_STRING, .offset = FIELD(name), .help = "Name of the sample or session"},
    {"sample", OPTION_STRING, .fallback = "", .offset = FIELD(described),
     .help = "What the sample is: material, maker, batch; for the report"},
    {"operator", OPTION_STRING, .fallback = "", .offset = FIELD(operator_name),
     .help = "Who captures it; for the report"},
    {"notes", OPTION_STRING, .fallback = "", .offset = FIELD(notes),
     .help = "Further notes for users of the data; for the report"},
    {"license", OPTION_STRING, .fallback = "", .offset = FIELD(license),
     .help = "Address (URL) of the licence of the data; for the report"},
    {NULL},
};

static const struct option sample_options[] = {
    {"width_mm", OPTION_DOUBLE, "mm", 0.1, 2000, .offset = CONF(grid.width_mm),
     .help = "Width of the sample, along x at turntable 0"},
    {"height_mm", OPTION_DOUBLE, "mm", 0.1, 2000, .offset = CONF(grid.height_mm),
     .help = "Height of the sample, along y at turntable 0"},
    {"texels", OPTION_INT, NULL, 0, 8192, "0", .offset = FIELD(texels),
     .help = "Texels across and along; or give texels_x and texels_y"},
    {"texels_x", OPTION_INT, NULL, 0, 8192, "0", .offset = FIELD(texels_x),
     .help = "Texels across the width"},
    {"texels_y", OPTION_INT, NULL, 0, 8192, "0", .offset = FIELD(texels_y),
     .help = "Texels along the height"},
    {"reference_mm", OPTION_DOUBLE, "mm", 0, 500, .offset = CONF(grid.reference_mm),
     .help = "Height of the reference plane, just above the structure, over the turntable's top"},
    {"depth_mm", OPTION_DOUBLE, "mm", 0, 500, .offset = CONF(grid.depth_mm),
     .help = "Depth of the structure below the reference plane, at most"},
    {"flat_radius_mm", OPTION_DOUBLE, "mm", 0, 2000, "0", .offset = FIELD(flat_radius_mm),
     .help = "Radius of a flat, level face around the sample, on which the laser's line shows "
             "where its sheet truly is; 0: there is none"},
    {"flat_hole_mm", OPTION_DOUBLES, "mm", 0, 2000, "", .offset = FIELD(flat_hole_mm),
     .help = "Width and height of the box in the middle of that face that holds the sample"},
    {"flat_mm", OPTION_DOUBLE, "mm", 0, 500, "0", .offset = FIELD(flat_mm),
     .help = "Height of that face over the turntable's top"},
    {"flat_error_mm", OPTION_DOUBLE, "mm", 0, 10, "0.02", .offset = FIELD(flat_error_mm),
     .help = "Standard error of flat_mm"},
    {NULL},
};

static const char *const blocked_choices[] = {"shift", "skip", "refuse", NULL};
static const char *const order_choices[] = {"quickest", "views", NULL};

static const struct option capture_options[] = {
    {"exposures_us", OPTION_DOUBLES, "us", 1, 60e6, .offset = FIELD(exposures_us),
     .help = "Exposures of one bracket under a lamp, ascending, at most twelve"},
    {"gain_db", OPTION_DOUBLE, "dB", 0, 60, "0", .offset = CONF(gain_db),
     .help = "Gain of all cameras"},
    {"laser_exposure_us", OPTION_DOUBLE, "us", 1, 60e6, "4000", .offset = CONF(laser_exposure_us),
     .help = "Exposure of a frame of a laser sweep"},
    {"laser_short_us", OPTION_DOUBLE, "us", 0, 60e6, "0", .offset = CONF(laser_short_us),
     .help = "Exposure of a second, shorter frame at each step of a laser sweep, for pixels that "
             "saturate in the first; 0: none"},
    {"sweep_steps", OPTION_INT, NULL, 8, MAX_SWEEP_STEPS, "96", .offset = CONF(sweep_steps),
     .help = "Frames of one laser sweep"},
    {"sweep_margin_mm", OPTION_DOUBLE, "mm", 0, 200, "2", .offset = CONF(sweep_margin_mm),
     .help = "How far a sweep goes beyond the sample on both sides"},
    {"dark_frames", OPTION_INT, NULL, 1, 1000, "4", .offset = CONF(dark_frames),
     .help = "Dark frames averaged for each exposure"},
    {"retries", OPTION_INT, NULL, 0, 100, "3", .offset = CONF(retries),
     .help = "How often a shot is taken again before the session is paused"},
    {"saturated_pct", OPTION_DOUBLE, "%", 0, 100, "0.1", .offset = CONF(saturated_pct),
     .help = "Pixels that may be saturated in the shortest exposure before a picture is taken "
             "again with a quarter of it"},
    {"laser_threshold_dn", OPTION_DOUBLE, "DN", 0, 65535, "40", .offset = CONF(laser_threshold_dn),
     .help = "How far a laser's peak must stand above the background to count"},
    {"on_blocked", OPTION_CHOICE, .fallback = "shift", .choices = blocked_choices,
     .offset = CONF(on_blocked),
     .help = "What to do where the light arc stands in a camera's picture"},
    {"order", OPTION_CHOICE, .fallback = "quickest", .choices = order_choices,
     .offset = CONF(order),
     .help = "The quickest order of shots, or view after view, so that the material can be looked "
             "at while it is captured"},
    {"keep_laser_frames", OPTION_BOOL, .fallback = "no", .offset = CONF(keep_laser_frames),
     .help = "Keep every frame of the laser sweeps as well"},
    {"keep_exposures", OPTION_BOOL, .fallback = "no", .offset = CONF(keep_exposures),
     .help = "Keep every dark frame and every exposure of a bracket as well; an exposure may then "
             "be given twice, for calibration measures noise from such pairs"},
    {NULL},
};

struct ring_fields {
    char *preset;
    char **rings, **devices;
    double offset_deg;
};

#define RING(member) G_STRUCT_OFFSET(struct ring_fields, member)

static const struct option ring_options[] = {
    {"preset", OPTION_STRING, .fallback = "", .offset = RING(preset),
     .help = "Directions by name: 12x5, 12x8, 81 or 26"},
    {"rings", OPTION_STRINGS, .fallback = "", .offset = RING(rings),
     .help = "Directions as theta:count or theta:count:offset, in degrees, one item a ring"},
    {"offset_deg", OPTION_DOUBLE, "degrees", -360, 360, "0", .offset = RING(offset_deg),
     .help = "Added to the azimuth of all rings"},
    {"devices", OPTION_STRINGS, .fallback = "", .offset = RING(devices),
     .help = "Instead of rings, names of the rig's cameras (lamps, lasers), or all: their "
             "directions with turntable and arc at 0"},
    {NULL},
};

static gboolean number_between(const char *text, double min, double max, double *ret) {
    char *end = NULL;

    *ret = g_ascii_strtod(text, &end);
    return *text && !*end && strspn(text, "0123456789+-.eE") == strlen(text) && *ret >= min &&
           *ret <= max;
}

static gboolean parse_ring(const char *text, struct ring *ring) {
    g_auto(GStrv) words = g_strsplit(text, ":", 4);
    guint n = g_strv_length(words);
    double count, offset = 0;

    if (n < 2 || n > 3)
        return FALSE;
    for (guint i = 0; i < n; i++)
        g_strstrip(words[i]);
    if (!number_between(words[0], 0, 89, &ring->theta_deg) ||
        !number_between(words[1], 1, 720, &count) || count != (int)count ||
        (n == 3 && !number_between(words[2], -360, 360, &offset)))
        return FALSE;
    ring->count = (int)count;
    ring->offset_deg = offset;
    return ring->theta_deg > 0 || ring->count == 1;
}

static int greatest_divisor(int a, int b) {
    return b ? greatest_divisor(b, a % b) : a;
}

/* Azimuths o1 + k·360/n1 and o2 + l·360/n2 meet where o1 − o2 is a multiple of 360/lcm(n1, n2). */
static gboolean rings_meet(const struct ring *a, const struct ring *b) {
    if (fabs(a->theta_deg - b->theta_deg) > 1e-6)
        return FALSE;
    if (a->theta_deg == 0)
        return TRUE;
    double lcm = (double)a->count / greatest_divisor(a->count, b->count) * b->count;
    double step = 360 / lcm;
    return fabs(remainder(a->offset_deg - b->offset_deg, step)) < 2e-6;
}

static gboolean fill_rings(const struct config_section *section, char **items, double offset_deg,
                           struct ring *rings, int *ret_n, GError **error) {
    guint n = g_strv_length(items);
    int directions = 0;

    if (n < 1 || n > PLAN_MAX_RINGS) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "rings", "%u rings; give 1 to %d", n,
                         PLAN_MAX_RINGS);
        return FALSE;
    }
    for (guint i = 0; i < n; i++) {
        if (!parse_ring(items[i], &rings[i])) {
            config_set_error(error, CONFIG_ERROR_VALUE, section, "rings",
                             "\"%s\" is not theta:count or theta:count:offset with theta from 0 to "
                             "89 degrees, count from 1 to 720 (1 at theta 0), offset from -360 to "
                             "360",
                             items[i]);
            return FALSE;
        }
        rings[i].offset_deg += offset_deg;
        directions += rings[i].count;
    }
    for (guint i = 0; i < n; i++)
        for (guint j = 0; j < i; j++)
            if (rings_meet(&rings[i], &rings[j])) {
                config_set_error(error, CONFIG_ERROR_VALUE, section, "rings",
                                 "rings %u and %u share a direction at theta %g; leave one out or "
                                 "give it another offset",
                                 j + 1, i + 1, rings[i].theta_deg);
                return FALSE;
            }
    if (directions > MAX_DIRECTIONS) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "rings",
                         "%d directions in all; at most %d", directions, MAX_DIRECTIONS);
        return FALSE;
    }
    *ret_n = (int)n;
    return TRUE;
}

static char **preset_rings(const struct config_section *section, const char *name, GError **error) {
    g_autoptr(GString) names = g_string_new(NULL);

    for (gsize i = 0; i < G_N_ELEMENTS(presets); i++) {
        if (g_str_equal(presets[i].name, name)) {
            char **items = g_strsplit(presets[i].rings, ";", -1);
            for (char **item = items; *item; item++)
                g_strstrip(*item);
            return items;
        }
        g_string_append_printf(names, "%s%s", names->len ? ", " : "", presets[i].name);
    }
    config_set_error(error, CONFIG_ERROR_UNKNOWN, section, "preset",
                     "there is no \"%s\"; choose from: %s, or write rings = theta:count; ...", name,
                     names->str);
    return NULL;
}

static gboolean read_rings(const struct config_section *section, struct ring *rings, int *ret_n,
                           char ***ret_devices, GError **error) {
    struct ring_fields fields = {0};

    *ret_n = 0;
    *ret_devices = NULL;
    if (!section)
        return TRUE;
    if (!options_parse(ring_options, section, NULL, &fields, error))
        return FALSE;
    gboolean ok = FALSE, has_preset = *fields.preset != '\0', has_rings = *fields.rings != NULL;
    const gboolean has_devices = *fields.devices != NULL;
    g_auto(GStrv) preset = NULL;
    if (has_preset + has_rings + has_devices != 1)
        config_set_error(error, CONFIG_ERROR_MISSING, section, NULL,
                         "give either preset, rings or devices%s",
                         has_preset || has_rings ? ", not both" : "");
    else if (has_devices && fields.offset_deg != 0)
        config_set_error(error, CONFIG_ERROR_VALUE, section, "offset_deg",
                         "turns rings only: the devices' positions are fixed; leave it out");
    else if (has_devices) {
        *ret_devices = g_steal_pointer(&fields.devices);
        ok = TRUE;
    } else if (!has_preset || (preset = preset_rings(section, fields.preset, error)))
        ok = fill_rings(section, preset ? preset : fields.rings, fields.offset_deg, rings, ret_n,
                        error);
    options_clear(ring_options, &fields);
    return ok;
}

static const struct config_section *session_conf_need(const Config *config, const char *class_name,
                                                      GError **error) {
    const struct config_section *section = config_find(config, class_name, NULL);

    if (!section)
        g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_MISSING, "%s: there is no section [%s]",
                    config_path(config), class_name);
    return section;
}

static gboolean check_sections(const Config *config, GError **error) {
    static const char *const known[] = {"session", "sample",  "views", "lights",
                                        "lasers",  "capture", NULL};
    gsize n;
    const struct config_section *sections = config_sections(config, &n);

    for (gsize i = 0; i < n; i++)
        if (!g_strv_contains(known, sections[i].class_name) || sections[i].name) {
            config_set_error(error, CONFIG_ERROR_UNKNOWN, &sections[i], NULL,
                             "there is no such section; a session file has [session] [sample] "
                             "[views] [lights] [lasers] [capture]");
            return FALSE;
        }
    return TRUE;
}

static gboolean session_conf_take_name(const struct config_section *section, struct fields *f,
                                       GError **error) {
    const char *name = f->name;

    if (!*name || *name == '.' || strlen(name) > 100 || strchr(name, '/') ||
        !g_utf8_validate(name, -1, NULL)) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "name",
                         "must be 1 to 100 characters that can be part of a file's name");
        return FALSE;
    }
    f->conf.name = g_steal_pointer(&f->name);
    return TRUE;
}

static gboolean take_sample(const struct config_section *section, struct fields *f,
                            GError **error) {
    struct session_grid *grid = &f->conf.grid;
    const struct option_doubles *hole = &f->flat_hole_mm;
    gboolean both = f->texels > 0, each = f->texels_x > 0 && f->texels_y > 0;

    if (both == each || (both && (f->texels_x || f->texels_y))) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "texels",
                         "give either texels, or both texels_x and texels_y, 1 or more");
        return FALSE;
    }
    if (grid->depth_mm > grid->reference_mm) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "depth_mm",
                         "%g mm reaches below the turntable's top: reference_mm is %g",
                         grid->depth_mm, grid->reference_mm);
        return FALSE;
    }
    grid->width = both ? f->texels : f->texels_x;
    grid->height = both ? f->texels : f->texels_y;
    if (f->flat_radius_mm == 0)
        return TRUE;
    if (hole->n != 2 || hole->values[0] < grid->width_mm || hole->values[1] < grid->height_mm) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "flat_hole_mm",
                         "must be two numbers, width; height, of a box that holds the sample, at "
                         "least %g;%g",
                         grid->width_mm, grid->height_mm);
        return FALSE;
    }
    if (f->flat_radius_mm <= MIN(hole->values[0], hole->values[1]) / 2 ||
        f->flat_mm > grid->reference_mm) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "flat_radius_mm",
                         "nothing of the flat face is left: it must reach beyond the box of "
                         "flat_hole_mm, and flat_mm may not be above reference_mm");
        return FALSE;
    }
    f->conf.reference = (struct laser_reference){.plane_mm = f->flat_mm,
                                                 .plane_error_mm = f->flat_error_mm,
                                                 .hole_mm = {hole->values[0], hole->values[1]},
                                                 .top_mm = grid->reference_mm,
                                                 .radius_mm = f->flat_radius_mm};
    return TRUE;
}

static gboolean take_capture(const struct config_section *section, struct fields *f,
                             GError **error) {
    struct session_conf *conf = &f->conf;
    int n = f->exposures_us.n;

    if (n < 1 || n > PLAN_MAX_BRACKET) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "exposures_us",
                         "%d exposures; give 1 to %d, separated by ';'", n, PLAN_MAX_BRACKET);
        return FALSE;
    }
    for (int i = 0; i < n; i++) {
        conf->exposures_us[i] = f->exposures_us.values[i];
        double before = i > 0 ? conf->exposures_us[i - 1] : 0;
        if (conf->exposures_us[i] < before ||
            (conf->exposures_us[i] == before && !conf->keep_exposures)) {
            config_set_error(
                error, CONFIG_ERROR_VALUE, section, "exposures_us",
                "%g must be longer than the %g before it: list the shortest exposure first",
                conf->exposures_us[i], before);
            return FALSE;
        }
    }
    conf->n_exposures = n;
    if (conf->laser_short_us == 0 ||
        (conf->laser_short_us >= 1 &&
         llround(conf->laser_short_us) < llround(conf->laser_exposure_us)))
        return TRUE;
    config_set_error(error, CONFIG_ERROR_VALUE, section, "laser_short_us",
                     "must be 0, or from 1 to less than laser_exposure_us, which is %g",
                     conf->laser_exposure_us);
    return FALSE;
}

static gboolean session_conf_read_directions(struct session_conf *conf, const Config *config,
                                             GError **error) {
    const struct config_section *views = session_conf_need(config, "views", error);

    if (!views || !read_rings(views, conf->views, &conf->n_views, &conf->views_of, error) ||
        !read_rings(config_find(config, "lights", NULL), conf->lights, &conf->n_lights,
                    &conf->lights_of, error) ||
        !read_rings(config_find(config, "lasers", NULL), conf->lasers, &conf->n_lasers,
                    &conf->lasers_of, error))
        return FALSE;
    if (conf->n_lights + conf->n_lasers > 0 || conf->lights_of || conf->lasers_of)
        return TRUE;
    g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_MISSING,
                "%s: there is neither [lights] nor [lasers]: nothing to take", config_path(config));
    return FALSE;
}

static gboolean read_section(const Config *config, const char *class_name,
                             const struct option *options, struct fields *f,
                             gboolean (*take)(const struct config_section *section,
                                              struct fields *f, GError **error),
                             GError **error) {
    const struct config_section *section = session_conf_need(config, class_name, error);

    if (!section || !options_parse(options, section, NULL, f, error))
        return FALSE;
    gboolean ok = take(section, f, error);
    options_clear(options, f);
    return ok;
}

/* Takes ownership of config; NULL: the error is set already. */
static gboolean read_config(struct session_conf *conf, Config *config, GError **error) {
    struct fields f = {0};

    *conf = f.conf;
    if (!config)
        return FALSE;
    f.conf.text = g_strdup(config_text(config));
    f.conf.path = g_strdup(config_path(config));
    gboolean ok =
        check_sections(config, error) &&
        read_section(config, "session", session_options, &f, session_conf_take_name, error) &&
        read_section(config, "sample", sample_options, &f, take_sample, error) &&
        session_conf_read_directions(&f.conf, config, error) &&
        read_section(config, "capture", capture_options, &f, take_capture, error);
    config_free(config);
    if (!ok)
        session_conf_clear(&f.conf);
    *conf = f.conf;
    return ok;
}

gboolean session_conf_load(struct session_conf *conf, const char *path, GError **error) {
    return read_config(conf, config_load(path, error), error);
}

gboolean session_conf_parse(struct session_conf *conf, const char *text, const char *path,
                            GError **error) {
    return read_config(conf, config_parse(text, path, error), error);
}

void session_conf_clear(struct session_conf *conf) {
    g_free(conf->name);
    g_free(conf->text);
    g_free(conf->path);
    g_strfreev(conf->views_of);
    g_strfreev(conf->lights_of);
    g_strfreev(conf->lasers_of);
    memset(conf, 0, sizeof *conf);
}
