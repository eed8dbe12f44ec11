#include "session_conf.h"

#include "base/nearest.h"

#include <string.h>

#define MAX_DIRECTIONS 4096
/* Limit of the number of steps: frames/sweep.c stores the step of a pixel's peak in 15 bits. */
#define MAX_SWEEP_STEPS G_MAXINT16

static const struct {
    const char *name, *rings;
} presets[] = {
    {"12x5", "15:12; 30:12; 45:12; 60:12; 75:12"},
    {"12x8", "12:12; 21:12; 30:12; 39:12; 48:12; 57:12; 66:12; 75:12"},
    {"81", "0:1; 15:6; 30:12; 45:18; 60:20; 75:24"},
    {"26", "15:2; 30:6; 45:6; 60:6; 75:6"},
};

struct fields { /* the session, and values that are checked before they are copied into it */
    struct session_conf conf;
    char *name, *prompt;
    /* Keys that are only accepted here, for the check of the file. cli/sessions/archive_read.c
     * reads their values from the session file that is stored in a session. */
    char *described, *operator_name, *notes, *license;
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
    {"prompt", OPTION_STRING, .fallback = "", .offset = FIELD(prompt),
     .help = "What an operator must do before the session begins, for instance lay the sample on "
             "the turntable; the queue of sessions shows this text and waits for mesorig continue"},
    {NULL},
};

static const struct option sample_options[] = {
    {"width_mm", OPTION_DOUBLE, "mm", 0.1, 2000, .offset = CONF(grid.width_mm),
     .help = "Width of the sample, along x at turntable 0"},
    {"height_mm", OPTION_DOUBLE, "mm", 0.1, 2000, .offset = CONF(grid.height_mm),
     .help = "Height of the sample, along y at turntable 0"},
    {"texels", OPTION_INT, NULL, 0, 8192, "0", .offset = FIELD(texels),
     .help = "Number of texels across the width and along the height; give this key, or texels_x "
             "and texels_y"},
    {"texels_x", OPTION_INT, NULL, 0, 8192, "0", .offset = FIELD(texels_x),
     .help = "Number of texels across the width"},
    {"texels_y", OPTION_INT, NULL, 0, 8192, "0", .offset = FIELD(texels_y),
     .help = "Number of texels along the height"},
    {"reference_mm", OPTION_DOUBLE, "mm", 0, 500, .offset = CONF(grid.reference_mm),
     .help = "Height of the reference plane, just above the structure, over the turntable's top"},
    {"depth_mm", OPTION_DOUBLE, "mm", 0, 500, .offset = CONF(grid.depth_mm),
     .help = "Maximum depth of the structure below the reference plane"},
    {"flat_radius_mm", OPTION_DOUBLE, "mm", 0, 2000, "0", .offset = FIELD(flat_radius_mm),
     .help = "Radius of a flat, level face around the sample, on which the laser's line is "
             "measured to correct the calibrated light sheet; 0: there is no such face"},
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
static const char *const motion_choices[] = {"standing", "continuous", NULL};

const char *const auto_key_names[AUTO_KEYS] = {
    [AUTO_EXPOSURES] = "exposures_us",
    [AUTO_LASER] = "laser_exposure_us",
    [AUTO_SHORT] = "laser_short_us",
};

static const struct option capture_options[] = {
    {"exposures_us", OPTION_DOUBLES, "us", 1, 60e6, .offset = FIELD(exposures_us),
     .help = "Exposures of one bracket under a lamp, ascending, at most twelve; or auto: they are "
             "chosen from test shots before the capture. laser_exposure_us and laser_short_us also "
             "accept auto"},
    {"auto_longest_us", OPTION_DOUBLE, "us", 100, 60e6, "100000", .offset = CONF(auto_longest_us),
     .help = "The longest exposure that auto may choose"},
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
     .help = "Number of times that a picture is taken again before the session is paused"},
    {"saturated_pct", OPTION_DOUBLE, "%", 0, 100, "0.1", .offset = CONF(saturated_pct),
     .help = "Share of pixels that may be saturated in the shortest exposure; with more, the "
             "picture is taken again with a quarter of that exposure"},
    {"laser_threshold_dn", OPTION_DOUBLE, "DN", 0, 65535, "40", .offset = CONF(laser_threshold_dn),
     .help = "Minimum height of a laser's peak above the background"},
    {"on_blocked", OPTION_CHOICE, .fallback = "shift", .choices = blocked_choices,
     .offset = CONF(on_blocked),
     .help = "What to do where the light arc stands in a camera's picture"},
    {"order", OPTION_CHOICE, .fallback = "quickest", .choices = order_choices,
     .offset = CONF(order),
     .help = "The quickest order of shots, or view after view, so that the material can be looked "
             "at while it is captured"},
    {"motion", OPTION_CHOICE, .fallback = "standing", .choices = motion_choices,
     .offset = CONF(motion),
     .help = "standing: the turntable stands still for each picture under a lamp; continuous: it "
             "turns without a stop, which needs an axis that reports its positions with their "
             "times, and a single exposure in exposures_us"},
    {"blur_texels", OPTION_DOUBLE, "texels", 0.001, 100, "0.25", .offset = CONF(blur_texels),
     .help =
         "With motion = continuous: part of a texel by which the sample's corner may move in an "
         "exposure; it limits the speed"},
    {"keep_laser_frames", OPTION_BOOL, .fallback = "no", .offset = CONF(keep_laser_frames),
     .help = "Keep every frame of the laser sweeps as well"},
    {"keep_exposures", OPTION_BOOL, .fallback = "no", .offset = CONF(keep_exposures),
     .help = "Keep every dark frame and every exposure of a bracket as well; an exposure may then "
             "be given twice, because a calibration measures the noise from such pairs"},
    {NULL},
};

static const char *const stop_choices[] = {"all", "covered", NULL};

static const char *const sampling_choices[] = {"all", "adaptive", NULL};

struct ring_fields {
    char *preset;
    char **rings, **devices;
    double offset_deg;
    int first; /* only in [lights] and [lasers] */
    /* Only in [lights]. */
    int sampling;
    double error_pct, budget_min;
    /* Only in [lasers]. */
    int stop;
    double gain_pct, line_mm;
};

#define RING(member) G_STRUCT_OFFSET(struct ring_fields, member)
#define RING_OPTIONS                                                                               \
    {"preset", OPTION_STRING, .fallback = "", .offset = RING(preset),                              \
     .help = "Directions by name: 12x5, 12x8, 81 or 26"},                                          \
        {"rings", OPTION_STRINGS, .fallback = "", .offset = RING(rings),                           \
         .help = "Directions as theta:count or theta:count:offset, in degrees, one item a ring"},  \
        {"offset_deg",                                                                             \
         OPTION_DOUBLE,                                                                            \
         "degrees",                                                                                \
         -360,                                                                                     \
         360,                                                                                      \
         "0",                                                                                      \
         .offset = RING(offset_deg),                                                               \
         .help = "Added to the azimuth of all rings"},                                             \
    {                                                                                              \
        "devices", OPTION_STRINGS,                                                                 \
            .fallback = "", .offset = RING(devices),                                               \
            .help = "Instead of rings, names of the rig's cameras (lamps, lasers), or all: their " \
                    "directions with turntable and arc at 0"                                       \
    }

static const struct option ring_options[] = {RING_OPTIONS, {NULL}};

static const struct option light_options[] = {
    RING_OPTIONS,
    {"sampling", OPTION_CHOICE, .fallback = "all", .choices = sampling_choices,
     .offset = RING(sampling),
     .help = "all: every view under every light; adaptive: in rounds, the pictures that are most "
             "informative for their time, until the others can be predicted; predicted pictures "
             "are marked"},
    {"first", OPTION_INT, NULL, 1, MAX_DIRECTIONS, "4", .offset = RING(first),
     .help = "With sampling = adaptive: lights of the first round for each angle of the "
             "turntable, on average"},
    {"error_pct", OPTION_DOUBLE, "%", 0, 100, "2", .offset = RING(error_pct),
     .help = "With sampling = adaptive: no further round if the expected error of the pictures, "
             "all together, is below this part of their root mean square"},
    {"budget_min", OPTION_DOUBLE, "min", 0, 100000, "0", .offset = RING(budget_min),
     .help = "With sampling = adaptive: maximum time of the lamps' shots, including the moves "
             "between them, without laser sweeps; 0: no limit"},
    {NULL},
};

static const struct option laser_options[] = {
    RING_OPTIONS,
    {"stop", OPTION_CHOICE, .fallback = "all", .choices = stop_choices, .offset = RING(stop),
     .help = "all: every sweep; covered: in rounds, only the sweeps that are expected to show more "
             "of the surface, until it is covered; sweeps that are left out are listed"},
    {"first", OPTION_INT, NULL, 1, COVERAGE_MAX_SWEEPS, "6", .offset = RING(first),
     .help = "With stop = covered: sweeps of the first round at each angle of the turntable"},
    {"gain_pct", OPTION_DOUBLE, "%", 0, 100, "0.3", .offset = RING(gain_pct),
     .help = "With stop = covered: minimum share of the texels of its views that a further sweep "
             "is expected to measure for the first time"},
    {"line_mm", OPTION_DOUBLE, "mm", 0, 100, "0", .offset = RING(line_mm),
     .help = "Full width at half maximum of the lines at the rig's origin; a sweep then has only "
             "as many steps as a line of this width needs, at most sweep_steps; 0: every sweep has "
             "sweep_steps"},
    {NULL},
};

const struct option *session_conf_options(const char *class_name) {
    static const struct {
        const char *class_name;
        const struct option *options;
    } tables[] = {{"session", session_options}, {"sample", sample_options},
                  {"views", ring_options},      {"lights", light_options},
                  {"lasers", laser_options},    {"capture", capture_options}};

    for (gsize i = 0; i < G_N_ELEMENTS(tables); i++)
        if (g_str_equal(class_name, tables[i].class_name))
            return tables[i].options;
    return NULL;
}

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

/* Returns whether two rings have a direction in common. The azimuths of a ring are o + k·360°/n,
 * where o is its offset, n its count and k an integer. Two rings have a common azimuth if and only
 * if o1 − o2 is a multiple of 360°/lcm(n1, n2). */
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
                           struct ring *rings, int *ret_n, Mistakes *mistakes) {
    guint n = g_strv_length(items);
    int directions = 0;

    if (n < 1 || n > PLAN_MAX_RINGS) {
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "rings",
                       "%u rings are given; give 1 to %d", n, PLAN_MAX_RINGS);
        return FALSE;
    }
    for (guint i = 0; i < n; i++) {
        if (!parse_ring(items[i], &rings[i])) {
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "rings",
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
                config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "rings",
                               "rings %u and %u share a direction at theta %g; leave one out or "
                               "give it another offset",
                               j + 1, i + 1, rings[i].theta_deg);
                return FALSE;
            }
    if (directions > MAX_DIRECTIONS) {
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "rings",
                       "the rings have %d directions; at most %d are allowed", directions,
                       MAX_DIRECTIONS);
        return FALSE;
    }
    *ret_n = (int)n;
    return TRUE;
}

static char **preset_rings(const struct config_section *section, const char *name,
                           Mistakes *mistakes) {
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
    config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, "preset",
                   "there is no \"%s\"; choose from: %s, or write rings = theta:count; ...", name,
                   names->str);
    return NULL;
}

static gboolean read_rings(const struct config_section *section, const struct option *options,
                           struct ring *rings, int *ret_n, char ***ret_devices,
                           struct ring_fields *ret_fields, Mistakes *mistakes) {
    struct ring_fields fields = {0};

    *ret_n = 0;
    *ret_devices = NULL;
    if (!section)
        return TRUE;
    if (!options_read(&(struct option_target){options, &fields}, 1, section, NULL, mistakes))
        return FALSE;
    gboolean ok = FALSE, has_preset = *fields.preset != '\0', has_rings = *fields.rings != NULL;
    const gboolean has_devices = *fields.devices != NULL;
    g_auto(GStrv) preset = NULL;
    g_autofree char *why = NULL;
    if (has_preset + has_rings + has_devices != 1)
        config_mistake(mistakes, CONFIG_ERROR_MISSING, section, NULL,
                       "give either preset, rings or devices%s",
                       has_preset || has_rings ? ", and only one of them" : "");
    else if (has_devices && fields.offset_deg != 0)
        config_mistake(
            mistakes, CONFIG_ERROR_VALUE, section, "offset_deg",
            "turns only rings, and the positions of devices are fixed; leave offset_deg out");
    else if (has_devices) {
        *ret_devices = g_steal_pointer(&fields.devices);
        ok = TRUE;
    } else if (!has_preset || (preset = preset_rings(section, fields.preset, mistakes)))
        ok = fill_rings(section, preset ? preset : fields.rings, fields.offset_deg, rings, ret_n,
                        mistakes);
    if (ret_fields)
        *ret_fields = fields;
    options_clear(options, &fields);
    return ok;
}

/* Checks the headings. Returns FALSE if one of them is wrong. A section that is not found may then
 * have the wrong heading, so it must not be reported as missing. */
static gboolean check_sections(const Config *config, Mistakes *mistakes) {
    static const char *const known[] = {"session", "sample",  "views", "lights",
                                        "lasers",  "capture", NULL};
    gsize n;
    const struct config_section *sections = config_sections(config, &n);
    gboolean good = config_has_all_sections(config);

    for (gsize i = 0; i < n; i++) {
        const struct config_section *section = &sections[i];
        struct nearest nearest = nearest_new(section->class_name);
        if (section->broken || (g_strv_contains(known, section->class_name) && !section->name))
            continue;
        for (const char *const *name = known; *name; name++)
            nearest_consider(&nearest, *name);
        good = nearest.name
                   ? config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                                    "there is no such section; did you mean [%s]?", nearest.name)
                   : config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                                    "there is no such section; a session file has [session] "
                                    "[sample] [views] [lights] [lasers] [capture]");
    }
    return good;
}

static gboolean take_name(const struct config_section *section, struct fields *f,
                          Mistakes *mistakes) {
    const char *name = f->name;

    if (!*name || *name == '.' || strlen(name) > 100 || strchr(name, '/') ||
        !g_utf8_validate(name, -1, NULL)) {
        config_mistake(
            mistakes, CONFIG_ERROR_VALUE, section, "name",
            "\"%s\" must be 1 to 100 bytes of UTF-8, without "
            "'/' and without '.' at the beginning, because it is a part of a file's name",
            name);
        return FALSE;
    }
    f->conf.name = g_steal_pointer(&f->name);
    f->conf.prompt = g_steal_pointer(&f->prompt);
    return TRUE;
}

static gboolean take_sample(const struct config_section *section, struct fields *f,
                            Mistakes *mistakes) {
    struct session_grid *grid = &f->conf.grid;
    const struct option_doubles *hole = &f->flat_hole_mm;
    gboolean both = f->texels > 0, each = f->texels_x > 0 && f->texels_y > 0, good = TRUE;

    if (both == each || (both && (f->texels_x || f->texels_y)))
        good = config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "texels",
                              "give either texels, or both texels_x and texels_y, 1 or more");
    if (grid->depth_mm > grid->reference_mm)
        good = config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "depth_mm",
                              "%g mm reaches below the turntable's top, because reference_mm is "
                              "%g: give at most that",
                              grid->depth_mm, grid->reference_mm);
    grid->width = both ? f->texels : f->texels_x;
    grid->height = both ? f->texels : f->texels_y;
    if (f->flat_radius_mm == 0)
        return good;
    if (hole->n != 2 || hole->values[0] < grid->width_mm || hole->values[1] < grid->height_mm)
        return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "flat_hole_mm",
                              "must be two numbers, width; height, of a box that holds the sample, "
                              "at least %g;%g",
                              grid->width_mm, grid->height_mm);
    if (f->flat_radius_mm <= MIN(hole->values[0], hole->values[1]) / 2)
        return config_mistake(
            mistakes, CONFIG_ERROR_VALUE, section, "flat_radius_mm",
            "nothing of the flat face is left: %g mm does not reach beyond the box "
            "of flat_hole_mm, %g;%g",
            f->flat_radius_mm, hole->values[0], hole->values[1]);
    if (f->flat_mm > grid->reference_mm)
        return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "flat_mm",
                              "%g mm is above reference_mm, which is %g; give at most %g",
                              f->flat_mm, grid->reference_mm, grid->reference_mm);
    f->conf.reference = (struct laser_reference){.plane_mm = f->flat_mm,
                                                 .plane_error_mm = f->flat_error_mm,
                                                 .hole_mm = {hole->values[0], hole->values[1]},
                                                 .top_mm = grid->reference_mm,
                                                 .radius_mm = f->flat_radius_mm};
    return good;
}

/* Sets upper bounds as the values of keys that are "auto", until values are chosen. A plan with
 * these values has the maximum predicted time. */
static void take_bounds(struct session_conf *conf) {
    if (conf->is_auto[AUTO_EXPOSURES]) {
        conf->n_exposures = conf->motion == MOTION_CONTINUOUS ? 1 : AUTO_MAX_EXPOSURES;
        double us = conf->auto_longest_us;
        for (int i = conf->n_exposures - 1; i >= 0; i--, us /= AUTO_FACTOR)
            conf->exposures_us[i] = us;
    }
    if (conf->is_auto[AUTO_LASER])
        conf->laser_exposure_us = conf->auto_longest_us;
    if (conf->is_auto[AUTO_SHORT])
        conf->laser_short_us = MAX(conf->laser_exposure_us / AUTO_FACTOR, 1);
}

static gboolean take_capture(const struct config_section *section, struct fields *f,
                             Mistakes *mistakes) {
    struct session_conf *conf = &f->conf;
    int n = f->exposures_us.n;
    gboolean good = TRUE;

    take_bounds(conf);
    if (conf->is_auto[AUTO_EXPOSURES])
        n = 0;
    else if (n < 1 || n > PLAN_MAX_BRACKET)
        good = config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "exposures_us",
                              "%d exposures are given; give 1 to %d, separated by ';'", n,
                              PLAN_MAX_BRACKET);
    else if (n > 1 && conf->motion == MOTION_CONTINUOUS)
        good = config_mistake(
            mistakes, CONFIG_ERROR_VALUE, section, "exposures_us",
            "%d exposures are given, but with motion = continuous the turntable turns on "
            "between them: give one, or set motion = standing",
            n);
    for (int i = 0; good && i < n; i++) {
        conf->exposures_us[i] = f->exposures_us.values[i];
        double before = i > 0 ? conf->exposures_us[i - 1] : 0;
        if (conf->exposures_us[i] < before ||
            (conf->exposures_us[i] == before && !conf->keep_exposures))
            good = config_mistake(
                mistakes, CONFIG_ERROR_VALUE, section, "exposures_us",
                "%g must be longer than the %g before it: list the shortest exposure first",
                conf->exposures_us[i], before);
    }
    if (!conf->is_auto[AUTO_EXPOSURES])
        conf->n_exposures = good ? n : 0;
    if (conf->laser_short_us == 0 || conf->is_auto[AUTO_SHORT] ||
        (conf->is_auto[AUTO_LASER] && conf->laser_short_us >= 1) ||
        (conf->laser_short_us >= 1 &&
         llround(conf->laser_short_us) < llround(conf->laser_exposure_us)))
        return good;
    if (conf->is_auto[AUTO_LASER])
        return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "laser_short_us",
                              "%g must be 0, or at least 1", conf->laser_short_us);
    return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "laser_short_us",
                          "%g must be 0, or from 1 to less than laser_exposure_us, which is %g",
                          conf->laser_short_us, conf->laser_exposure_us);
}

static void read_directions(struct session_conf *conf, const Config *config, gboolean all_sections,
                            Mistakes *mistakes) {
    const struct config_section *views = config_find(config, "views", NULL);
    const struct config_section *lights = config_find(config, "lights", NULL);
    const struct config_section *lasers = config_find(config, "lasers", NULL);

    if (!views && all_sections)
        config_lacks(mistakes, config, "there is no section [views]; add it");
    struct ring_fields fields = {0}, of_lights = {0};
    read_rings(views, ring_options, conf->views, &conf->n_views, &conf->views_of, NULL, mistakes);
    read_rings(lights, light_options, conf->lights, &conf->n_lights, &conf->lights_of, &of_lights,
               mistakes);
    conf->light_sampling = (enum light_sampling)of_lights.sampling;
    conf->light_first = of_lights.first;
    conf->light_error_pct = of_lights.error_pct;
    conf->light_budget_min = of_lights.budget_min;
    read_rings(lasers, laser_options, conf->lasers, &conf->n_lasers, &conf->lasers_of, &fields,
               mistakes);
    conf->laser_stop = (enum laser_stop)fields.stop;
    conf->laser_first = fields.first;
    conf->laser_gain_pct = fields.gain_pct;
    conf->laser_line_mm = fields.line_mm;
    if (!lights && !lasers && all_sections)
        config_lacks(mistakes, config,
                     "there is neither [lights] nor [lasers], so there is nothing to capture; add "
                     "one of them");
}

/* Reads a section into f by its option table. If the section has no mistakes, calls take(). `also`
 * lists further keys that are valid, or is NULL. If all_sections is TRUE, a missing section is a
 * mistake. */
static void read_section(const Config *config, const char *class_name, const struct option *options,
                         const char *const *also, struct fields *f,
                         gboolean (*take)(const struct config_section *section, struct fields *f,
                                          Mistakes *mistakes),
                         gboolean all_sections, Mistakes *mistakes) {
    const struct config_section *section = config_find(config, class_name, NULL);

    if (!section && all_sections)
        config_lacks(mistakes, config, "there is no section [%s]; add it", class_name);
    if (section && options_read(&(struct option_target){options, f}, 1, section, also, mistakes)) {
        take(section, f, mistakes);
        options_clear(options, f);
    }
}

/* Reads [capture] without the keys that are "auto", and sets is_auto for these keys. */
static void read_capture(const Config *config, struct fields *f, gboolean all_sections,
                         Mistakes *mistakes) {
    const struct config_section *section = config_find(config, "capture", NULL);
    struct option options[G_N_ELEMENTS(capture_options)];
    const char *automatic[AUTO_KEYS + 1] = {0};
    int n = 0, n_auto = 0;

    for (const struct option *option = capture_options; section && option->name; option++) {
        int key = 0;
        while (key < AUTO_KEYS && !g_str_equal(option->name, auto_key_names[key]))
            key++;
        if (key < AUTO_KEYS && g_strcmp0(config_value(section, option->name, NULL), "auto") == 0) {
            f->conf.is_auto[key] = TRUE;
            automatic[n_auto++] = option->name;
        } else {
            options[n++] = *option;
        }
    }
    options[n] = (struct option){NULL};
    read_section(config, "capture", options, automatic, f, take_capture, all_sections, mistakes);
}

/* Fills conf from config. On failure, sets the error from mistakes, and conf is empty. Takes
 * ownership of config. If config is NULL, mistakes must contain the reason. */
static gboolean read_config(struct session_conf *conf, Config *config, Mistakes *mistakes,
                            GError **error) {
    struct fields f = {0};

    if (config) {
        const gboolean all = check_sections(config, mistakes);
        f.conf.text = g_strdup(config_text(config));
        f.conf.path = g_strdup(config_path(config));
        read_section(config, "session", session_options, NULL, &f, take_name, all, mistakes);
        read_section(config, "sample", sample_options, NULL, &f, take_sample, all, mistakes);
        read_directions(&f.conf, config, all, mistakes);
        read_capture(config, &f, all, mistakes);
        config_free(config);
    }
    const gboolean good = mistakes_report(mistakes, error);
    if (!good)
        session_conf_clear(&f.conf);
    *conf = f.conf;
    return good;
}

gboolean session_conf_load(struct session_conf *conf, const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();

    return read_config(conf, config_load_checked(path, mistakes), mistakes, error);
}

gboolean session_conf_parse(struct session_conf *conf, const char *text, const char *path,
                            GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();

    return read_config(conf, config_parse_checked(text, path, mistakes), mistakes, error);
}

/* Returns the value of a key in lines "KEY = VALUE", or NULL if there is none; g_free(). */
static char *chosen_value(const char *lines, const char *key) {
    g_auto(GStrv) all = g_strsplit(lines, "\n", -1);

    for (char **line = all; *line; line++) {
        char *value = strchr(*line, '=');
        if (!value)
            continue;
        *value++ = '\0';
        if (g_str_equal(g_strstrip(*line), key))
            return g_strdup(g_strstrip(value));
    }
    return NULL;
}

gboolean session_conf_check_chosen(const struct session_conf *conf, GError **error) {
    for (int key = 0; key < AUTO_KEYS; key++)
        if (conf->is_auto[key]) {
            g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_VALUE,
                        "%s: [capture] %s is auto: `mesorig capture` chooses it from test shots; "
                        "another program must pass its choice in the option “chosen” of the method "
                        "Start",
                        conf->path, auto_key_names[key]);
            return FALSE;
        }
    return TRUE;
}

gboolean session_conf_choose(struct session_conf *conf, const char *chosen, GError **error) {
    g_auto(GStrv) lines = g_strsplit(conf->text, "\n", -1);
    g_autoptr(GString) text = g_string_new(NULL);
    g_autoptr(GString) said = g_string_new(NULL);
    char *values[AUTO_KEYS] = {0};
    gboolean capture = FALSE;

    for (int key = 0; key < AUTO_KEYS; key++)
        if (conf->is_auto[key] && (values[key] = chosen_value(chosen, auto_key_names[key])))
            g_string_append_printf(said, "%s%s = %s", said->len ? ", " : "", auto_key_names[key],
                                   values[key]);
    for (char **line = lines; *line; line++) {
        g_autofree char *name = g_strndup(*line, strcspn(*line, "="));
        const char *value = NULL;
        g_strstrip(name);
        capture = *name == '[' ? g_str_has_prefix(name, "[capture]") : capture;
        for (int key = 0; key < AUTO_KEYS && capture; key++)
            value = g_str_equal(name, auto_key_names[key]) ? values[key] : value;
        if (value)
            g_string_append_printf(text, "%s = %s", name, value);
        else
            g_string_append(text, *line);
        if (line[1])
            g_string_append_c(text, '\n');
    }
    for (int key = 0; key < AUTO_KEYS; key++)
        g_free(values[key]);
    struct session_conf whole;
    if (!session_conf_parse(&whole, text->str, conf->path, error))
        return FALSE;
    session_conf_clear(conf);
    *conf = whole;
    if (said->len)
        conf->chosen = g_strdup(said->str);
    return session_conf_check_chosen(conf, error);
}

void session_conf_clear(struct session_conf *conf) {
    g_free(conf->name);
    g_free(conf->prompt);
    g_free(conf->text);
    g_free(conf->path);
    g_free(conf->chosen);
    g_strfreev(conf->views_of);
    g_strfreev(conf->lights_of);
    g_strfreev(conf->lasers_of);
    memset(conf, 0, sizeof *conf);
}
