#include "devices_private.h"

#include "base/nearest.h"

#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
#define MAX_KEYS 32

struct rig_fields {
    char *id, *calibration;
    int clock;
    double calibration_days, arc_radius_mm, arc_width_mm;
};

static const char *const clock_choices[] = {"real", "virtual", NULL};

#define RIG(member) G_STRUCT_OFFSET(struct rig_fields, member)
static const struct option rig_options[] = {
    {"id", OPTION_STRING, .offset = RIG(id),
     .help = "Name of this rig; a calibration of another one is refused"},
    {"clock", OPTION_CHOICE, .fallback = "real", .choices = clock_choices, .offset = RIG(clock),
     .help = "Virtual time jumps to the next event; for simulated devices only"},
    {"calibration", OPTION_STRING, .fallback = "", .offset = RIG(calibration),
     .help = "The rig's calibration file, relative to this file; without it, the geometry and "
             "light of this file are used"},
    {"calibration_days", OPTION_DOUBLE, "days", 0, 100000, "30", .offset = RIG(calibration_days),
     .help = "Age from which an old calibration of a part causes a warning"},
    {"arc_radius_mm", OPTION_DOUBLE, "mm", 0, 100000, "0", .offset = RIG(arc_radius_mm),
     .help = "Radius of the light arc's inner edge; a rig with [axis arc] must have it"},
    {"arc_width_mm", OPTION_DOUBLE, "mm", 0, 10000, "0", .offset = RIG(arc_width_mm),
     .help = "Width of the light arc with its lamps, and of lamps and cameras that stand by "
             "themselves; it determines what they hide from a camera or a lamp"},
    {NULL},
};

struct place_fields { /* of a lamp, camera or laser */
    char *bank, *sweep, *mount_of;
    int index, width, height;
    double park_deg; /* of an axis */
    double theta_deg, phi_deg, distance_mm, exponent, intensity, focal_px, response;
    double k1, k2, k3, p1, p2, vignetting;
};

#define PLACE(member) G_STRUCT_OFFSET(struct place_fields, member)
#define THETA                                                                                      \
    {                                                                                              \
        "theta_deg", OPTION_DOUBLE, "degrees", 0, 89.9,                                            \
            .offset = PLACE(theta_deg), .help = "Elevation it stands at, from straight above"      \
    }
#define DISTANCE                                                                                   \
    {                                                                                              \
        "distance_mm", OPTION_DOUBLE, "mm", 1, 100000,                                             \
            .offset = PLACE(distance_mm),                                                          \
            .help = "Distance from the middle of the turntable's top, which it points at"          \
    }
#define AZIMUTH                                                                                    \
    {                                                                                              \
        "phi_deg", OPTION_DOUBLE, "degrees", -360, 360, "0",                                       \
            .offset = PLACE(phi_deg),                                                              \
            .help =                                                                                \
                "Azimuth it stands at by itself, counter-clockwise seen from above; without it "   \
                "the arc carries it"                                                               \
    }

static const struct option axis_options[] = {
    {LAYOUT_PARK_KEY, OPTION_DOUBLE, "degrees", -36000, 36000, "0", .offset = PLACE(park_deg),
     .help = "Where it stands when the queue of sessions is empty; without it, at its reference"},
    {NULL},
};

static const struct option lamp_options[] = {
    {"bank", OPTION_STRING, .offset = PLACE(bank), .help = "The lamp bank that switches it"},
    {"index", OPTION_INT, NULL, 0, 1023, .offset = PLACE(index),
     .help = "Its number there, from 0"},
    THETA,
    AZIMUTH,
    DISTANCE,
    {"exponent", OPTION_DOUBLE, NULL, 0, 1000, "1", .offset = PLACE(exponent),
     .help = "Its intensity falls with this power of the cosine of the angle from its axis"},
    {"intensity", OPTION_DOUBLE, "W/sr", 1e-6, RIG_MOST_INTENSITY, "1", .offset = PLACE(intensity),
     .help = "Radiant intensity along its axis"},
    {NULL},
};

static const struct option camera_options[] = {
    THETA,
    {"phi_deg", OPTION_DOUBLE, "degrees", -360, 360, .offset = PLACE(phi_deg),
     .help = "Azimuth it stands at, counter-clockwise seen from above; for a camera overhead, its "
             "rotation"},
    DISTANCE,
    {"width", OPTION_INT, "px", 1, 65536, .offset = PLACE(width), .help = "Width of its pictures"},
    {"height", OPTION_INT, "px", 1, 65536, .offset = PLACE(height),
     .help = "Height of its pictures"},
    {"focal_px", OPTION_DOUBLE, "px", 1, 1e6, .offset = PLACE(focal_px), .help = "Focal length"},
    {"response", OPTION_DOUBLE, "DN/s per W/(sr m²)", RIG_LEAST_RESPONSE, RIG_MOST_RESPONSE, "1",
     .offset = PLACE(response), .help = "Counts a second for a radiance of one, at no gain"},
    {"k1", OPTION_DOUBLE, NULL, -100, 100, "0", .offset = PLACE(k1), .help = "Radial distortion"},
    {"k2", OPTION_DOUBLE, NULL, -100, 100, "0", .offset = PLACE(k2), .help = "Radial distortion"},
    {"k3", OPTION_DOUBLE, NULL, -100, 100, "0", .offset = PLACE(k3), .help = "Radial distortion"},
    {"p1", OPTION_DOUBLE, NULL, -10, 10, "0", .offset = PLACE(p1), .help = "Tangential distortion"},
    {"p2", OPTION_DOUBLE, NULL, -10, 10, "0", .offset = PLACE(p2), .help = "Tangential distortion"},
    {"vignetting", OPTION_DOUBLE, NULL, 0, 0.99, "0", .offset = PLACE(vignetting),
     .help = "Part of the response that is lost in the corners"},
    {NULL},
};

static const struct option laser_options[] = {
    {"sweep", OPTION_STRING, .offset = PLACE(sweep), .help = "The axis that sweeps its line"},
    {"mount_of", OPTION_STRING, .fallback = "", .offset = PLACE(mount_of),
     .help = "The laser that is mounted here by hand; such a section gives only its place"},
    THETA,
    AZIMUTH,
    DISTANCE,
    {NULL},
};

static const struct option mount_options[] = {
    {"mount_of", OPTION_STRING, .offset = PLACE(mount_of),
     .help = "The laser that is mounted here by hand"},
    THETA,
    AZIMUTH,
    DISTANCE,
    {NULL},
};

struct mark_fields {
    double x_mm, y_mm, z_mm, radius_mm;
    struct option_doubles reflectance;
};

#define MARK(member) G_STRUCT_OFFSET(struct mark_fields, member)
static const struct option mark_place_options[] = {
    {"x_mm", OPTION_DOUBLE, "mm", -10000, 10000, .offset = MARK(x_mm),
     .help = "Its middle, with the turntable at 0"},
    {"y_mm", OPTION_DOUBLE, "mm", -10000, 10000, .offset = MARK(y_mm), .help = "Its middle"},
    {"z_mm", OPTION_DOUBLE, "mm", -1000, 1000, "0", .offset = MARK(z_mm),
     .help = "Its face, above the turntable's top"},
    {"radius_mm", OPTION_DOUBLE, "mm", 0.1, 1000, .offset = MARK(radius_mm), .help = "Of its face"},
    {"reflectance", OPTION_DOUBLES, NULL, 0.01, 2, "0.9", .offset = MARK(reflectance),
     .help = "Of its face, one value or three for red, green and blue"},
    {NULL},
};

const struct option *devices_section_options(const char *class_name) {
    static const struct {
        const char *class_name;
        const struct option *options;
    } tables[] = {{"rig", rig_options},     {"axis", axis_options},
                  {"lamp", lamp_options},   {"camera", camera_options},
                  {"laser", laser_options}, {"mark", mark_place_options}};

    for (gsize i = 0; i < G_N_ELEMENTS(tables); i++)
        if (g_str_equal(class_name, tables[i].class_name))
            return tables[i].options;
    return NULL;
}

static const char **devices_layout_names_of(const struct option *options, const char *first) {
    GPtrArray *names = g_ptr_array_new();

    if (first)
        g_ptr_array_add(names, (gpointer)first);
    for (; options && options->name; options++)
        g_ptr_array_add(names, (gpointer)options->name);
    g_ptr_array_add(names, NULL);
    return (const char **)g_ptr_array_free(names, FALSE);
}

const char **layout_keys(const char *class_name) {
    return devices_layout_names_of(devices_section_options(class_name), NULL);
}

/* Checks the driver's options without opening it, and reads the rig's own from the same section.
 * Without a driver, those are checked alone. */
static gboolean devices_layout_read_device(const struct config_section *section,
                                           struct place_fields *place, Mistakes *mistakes) {
    static const char *const only_driver[] = {"driver", NULL}, *const any[] = {"*", NULL};
    GError *error = NULL;
    const struct driver_info *info = drivers_find(section, &error);
    const struct option *options = devices_section_options(section->class_name);
    const struct option_target ours = {options, place};

    if (!info) {
        mistakes_add(mistakes, error);
        if (options && options_read(&ours, 1, section, any, mistakes))
            options_clear(options, place);
        return FALSE;
    }
    g_autofree gpointer priv = g_malloc0(MAX(info->priv_size, 1));
    const struct option_target both[] = {{info->options, priv}, ours};
    if (!options_read(both, options ? 2 : 1, section, only_driver, mistakes))
        return FALSE;
    options_clear(info->options, priv);
    return TRUE;
}

static gboolean devices_layout_read_rig(struct layout *layout, Mistakes *mistakes) {
    const struct config_section *section = config_find(layout->config, "rig", NULL);
    struct rig_fields fields = {0};

    if (!section || section->name)
        return layout->has_all_sections
                   ? config_lacks(mistakes, layout->config, "there is no section [rig]")
                   : FALSE;
    if (!options_read(&(struct option_target){rig_options, &fields}, 1, section, NULL, mistakes))
        return FALSE;
    gboolean ok = *fields.id && strlen(fields.id) < sizeof layout->geometry.id;
    if (ok)
        g_strlcpy(layout->geometry.id, fields.id, sizeof layout->geometry.id);
    else
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "id", "must be 1 to %d bytes long",
                       (int)sizeof layout->geometry.id - 1);
    if (layout->arc && fields.arc_radius_mm == 0)
        ok = config_mistake(mistakes, CONFIG_ERROR_MISSING, section, "arc_radius_mm",
                            "must be given: there is an [axis arc]");
    layout->geometry.arc_radius_mm = fields.arc_radius_mm;
    layout->geometry.arc_width_mm = fields.arc_width_mm;
    layout->virtual_clock = fields.clock == 1;
    layout->calibration_days = fields.calibration_days;
    if (*fields.calibration) {
        g_autofree char *folder = g_path_get_dirname(config_path(layout->config));
        layout->calibration_path = g_canonicalize_filename(fields.calibration, folder);
    }
    options_clear(rig_options, &fields);
    return ok;
}

static gboolean count_up(int *n, int most, const struct config_section *section,
                         Mistakes *mistakes) {
    if (*n < most) {
        (*n)++;
        return TRUE;
    }
    return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                          "one too many: there may be %d of this class", most);
}

static gboolean devices_layout_take_name(const struct config_section *section, char to[RIG_NAME],
                                         Mistakes *mistakes) {
    if (strlen(section->name) < RIG_NAME) {
        g_strlcpy(to, section->name, RIG_NAME);
        return TRUE;
    }
    return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                          "the name must be UTF-8 of at most %d bytes", RIG_NAME - 1);
}

static struct vec3 devices_layout_position(const struct place_fields *place) {
    return vec3_scale(rig_direction(RAD(place->theta_deg), RAD(place->phi_deg)),
                      place->distance_mm);
}

/* Whether a lamp or laser stands by itself: where its azimuth is given, and overhead, where it has
 * none, if there is no arc. */
static gboolean devices_layout_take_carrier(const struct layout *layout,
                                            const struct config_section *section,
                                            const struct place_fields *place, int *ret_fixed,
                                            Mistakes *mistakes) {
    const gboolean given = config_value(section, "phi_deg", NULL) != NULL;

    *ret_fixed = given || !layout->arc;
    if (given || layout->arc || place->theta_deg == 0)
        return TRUE;
    return layout->has_all_sections
               ? config_mistake(mistakes, CONFIG_ERROR_MISSING, section, "phi_deg",
                                "must be given: there is no [axis arc] that would carry it")
               : FALSE;
}

static gboolean read_camera(struct layout *layout, const struct config_section *section,
                            Mistakes *mistakes) {
    struct rig *rig = &layout->geometry;
    struct place_fields p = {0};
    int i = rig->n_cameras;

    if (!count_up(&rig->n_cameras, RIG_MAX_CAMERAS, section, mistakes))
        return FALSE;
    const gboolean named = devices_layout_take_name(section, rig->cameras[i].name, mistakes);
    if (!devices_layout_read_device(section, &p, mistakes) || !named)
        return FALSE;
    struct rig_camera *camera = &rig->cameras[i];
    camera->width = p.width;
    camera->height = p.height;
    camera->fx_px = camera->fy_px = p.focal_px;
    camera->cx_px = (p.width - 1) / 2.0;
    camera->cy_px = (p.height - 1) / 2.0;
    camera->k1 = p.k1;
    camera->k2 = p.k2;
    camera->k3 = p.k3;
    camera->p1 = p.p1;
    camera->p2 = p.p2;
    camera->vignetting = p.vignetting;
    camera->response = p.response;
    rig_camera_look_at(camera, devices_layout_position(&p), vec3(0, 0, 0));
    if (p.theta_deg == 0) /* overhead, the azimuth is its rotation about its own axis */
        for (int k = 0; k < 2; k++) {
            double *row = camera->rotation.m[k];
            const struct vec3 turned = rig_turn(vec3(row[0], row[1], row[2]), RAD(p.phi_deg));
            row[0] = turned.x, row[1] = turned.y, row[2] = turned.z;
        }
    layout->cameras[i] = section;
    return TRUE;
}

static int find_section(const struct config_section *const *sections, int n, const char *name) {
    for (int i = 0; i < n; i++)
        if (g_str_equal(sections[i]->name, name))
            return i;
    return -1;
}

static gboolean wire_lamp(struct layout *layout, int i, const struct place_fields *p,
                          Mistakes *mistakes) {
    const struct config_section *section = layout->lamps[i];
    int bank = find_section(layout->banks, layout->n_banks, p->bank);

    if (bank < 0)
        return layout->has_all_sections
                   ? config_mistake(mistakes, CONFIG_ERROR_MISSING, section, "bank",
                                    "there is no section [lamps %s]; name one that there is",
                                    p->bank)
                   : FALSE;
    for (int k = 0; k < i; k++)
        if (layout->lamp_bank[k] == bank && layout->lamp_index[k] == p->index)
            return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "index",
                                  "lamp %d of %s is [lamp %s] already, in line %d", p->index,
                                  p->bank, layout->lamps[k]->name, layout->lamps[k]->line);
    layout->lamp_bank[i] = bank;
    layout->lamp_index[i] = p->index;
    return TRUE;
}

static gboolean read_lamp(struct layout *layout, const struct config_section *section,
                          Mistakes *mistakes) {
    struct rig *rig = &layout->geometry;
    struct place_fields p = {0};
    int i = rig->n_lamps;

    if (!count_up(&rig->n_lamps, RIG_MAX_LAMPS, section, mistakes))
        return FALSE;
    layout->lamps[i] = section;
    layout->lamp_bank[i] = -1;
    const gboolean named = devices_layout_take_name(section, rig->lamps[i].name, mistakes);
    if (!options_read(&(struct option_target){lamp_options, &p}, 1, section, NULL, mistakes))
        return FALSE;
    const gboolean carried =
        devices_layout_take_carrier(layout, section, &p, &rig->lamps[i].fixed, mistakes);
    const gboolean wired = wire_lamp(layout, i, &p, mistakes);
    rig->lamps[i].position_mm = devices_layout_position(&p);
    rig->lamps[i].aim = vec3_scale(vec3_unit(rig->lamps[i].position_mm), -1);
    rig->lamps[i].exponent = p.exponent;
    rig->lamps[i].intensity = p.intensity;
    options_clear(lamp_options, &p);
    return named && carried && wired;
}

static gboolean wire_laser(struct layout *layout, int i, const char *sweep, Mistakes *mistakes) {
    const struct config_section *axis = config_find(layout->config, "axis", sweep);

    if (axis && axis != layout->turntable && axis != layout->arc) {
        layout->sweeps[i] = axis;
        return TRUE;
    }
    if (!axis && !layout->has_all_sections)
        return FALSE;
    return config_mistake(mistakes, CONFIG_ERROR_MISSING, layout->lasers[i], "sweep",
                          axis
                              ? "the axis \"%s\" does not sweep a laser; give it an axis of its own"
                              : "there is no section [axis %s]; name the axis that sweeps the line",
                          sweep);
}

/* A further place of a laser that stands above it in the file. */
static gboolean wire_mount(struct layout *layout, int i, const char *name, Mistakes *mistakes) {
    int unit = find_section(layout->lasers, i, name);

    if (unit >= 0 && layout->unit[unit] == unit) {
        layout->unit[i] = unit;
        layout->sweeps[i] = layout->sweeps[unit];
        return TRUE;
    }
    if (unit < 0 && !layout->has_all_sections)
        return FALSE;
    return config_mistake(mistakes, CONFIG_ERROR_MISSING, layout->lasers[i], "mount_of",
                          unit >= 0
                              ? "\"%s\" is itself a mount; name the laser that it is a mount of"
                              : "there is no section [laser %s] above this one; name the laser "
                                "that is mounted here, and write it first",
                          name);
}

static gboolean read_laser(struct layout *layout, const struct config_section *section,
                           Mistakes *mistakes) {
    struct rig *rig = &layout->geometry;
    struct place_fields p = {0};
    int i = rig->n_lasers;

    if (!count_up(&rig->n_lasers, RIG_MAX_LASERS, section, mistakes))
        return FALSE;
    layout->lasers[i] = section;
    layout->unit[i] = i;
    struct rig_laser *laser = &rig->lasers[i];
    const gboolean named = devices_layout_take_name(section, laser->name, mistakes);
    const gboolean mounted = config_value(section, "mount_of", NULL) != NULL;
    if (!(mounted
              ? options_read(&(struct option_target){mount_options, &p}, 1, section, NULL, mistakes)
              : devices_layout_read_device(section, &p, mistakes)))
        return FALSE;
    const gboolean wired = mounted ? wire_mount(layout, i, p.mount_of, mistakes)
                                   : wire_laser(layout, i, p.sweep, mistakes);
    const gboolean carried =
        devices_layout_take_carrier(layout, section, &p, &laser->fixed, mistakes);
    const gboolean ok = named && wired && carried;
    if (ok) {
        laser->position_mm = devices_layout_position(&p);
        laser->axis = rig_turn(vec3(0, 1, 0), RAD(p.phi_deg));
        laser->normal = vec3_unit(vec3_cross(laser->axis, vec3_scale(laser->position_mm, -1)));
    }
    options_clear(laser_options, &p);
    return ok;
}

static gboolean read_mark(struct layout *layout, const struct config_section *section,
                          Mistakes *mistakes) {
    struct rig *rig = &layout->geometry;
    struct mark_fields p = {0};
    int i = rig->n_fiducials;

    if (!count_up(&rig->n_fiducials, RIG_MAX_FIDUCIALS, section, mistakes))
        return FALSE;
    const gboolean named = devices_layout_take_name(section, rig->fiducials[i].name, mistakes);
    if (!options_read(&(struct option_target){mark_place_options, &p}, 1, section, NULL, mistakes))
        return FALSE;
    gboolean ok = p.reflectance.n == 1 || p.reflectance.n == 3;
    if (!ok)
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "reflectance",
                       "%d numbers are given; give one, or three separated by ';'",
                       p.reflectance.n);
    rig->fiducials[i].centre_mm = vec3(p.x_mm, p.y_mm, p.z_mm);
    rig->fiducials[i].radius_mm = p.radius_mm;
    for (int k = 0; ok && k < 3; k++)
        rig->fiducials[i].reflectance[k] = p.reflectance.values[p.reflectance.n == 3 ? k : 0];
    options_clear(mark_place_options, &p);
    return ok && named;
}

static gboolean take_section(struct layout *layout, const struct config_section *section,
                             Mistakes *mistakes) {
    if (g_str_equal(section->class_name, "axis")) {
        struct place_fields fields = {0};
        if (g_str_equal(section->name, "turntable"))
            layout->turntable = section;
        if (g_str_equal(section->name, "arc"))
            layout->arc = section;
        return devices_layout_read_device(section, &fields, mistakes);
    }
    if (g_str_equal(section->class_name, "lamps")) {
        layout->banks[MIN(layout->n_banks, DEVICES_MAX_BANKS - 1)] = section;
        return count_up(&layout->n_banks, DEVICES_MAX_BANKS, section, mistakes) &&
               devices_layout_read_device(section, NULL, mistakes);
    }
    if (g_str_equal(section->class_name, "interlock")) {
        layout->interlocks[MIN(layout->n_interlocks, DEVICES_MAX_INTERLOCKS - 1)] = section;
        return count_up(&layout->n_interlocks, DEVICES_MAX_INTERLOCKS, section, mistakes) &&
               devices_layout_read_device(section, NULL, mistakes);
    }
    return TRUE;
}

static gboolean devices_layout_take_place(struct layout *layout,
                                          const struct config_section *section,
                                          Mistakes *mistakes) {
    if (g_str_equal(section->class_name, "camera"))
        return read_camera(layout, section, mistakes);
    if (g_str_equal(section->class_name, "lamp"))
        return read_lamp(layout, section, mistakes);
    if (g_str_equal(section->class_name, "laser"))
        return read_laser(layout, section, mistakes);
    if (g_str_equal(section->class_name, "mark"))
        return read_mark(layout, section, mistakes);
    return TRUE;
}

/* Sections that no rig file has; what they were to be may then seem to be missing. */
static gboolean check_class(struct layout *layout, const struct config_section *section,
                            Mistakes *mistakes) {
    static const char *const named[] = {"axis",  "lamps",     "lamp", "camera",
                                        "laser", "interlock", "mark", NULL};
    const gboolean is_rig = g_str_equal(section->class_name, "rig");

    if (is_rig == (section->name == NULL) &&
        (is_rig || g_strv_contains(named, section->class_name)))
        return TRUE;
    layout->has_all_sections = FALSE;
    if (is_rig || g_strv_contains(named, section->class_name))
        return config_mistake(mistakes, CONFIG_ERROR_SYNTAX, section, NULL,
                              is_rig ? "has no name: write [rig]%s"
                                     : "needs a name: write [%s NAME]",
                              is_rig ? "" : section->class_name);
    struct nearest nearest = nearest_new(section->class_name);
    nearest_consider(&nearest, "rig");
    for (const char *const *name = named; *name; name++)
        nearest_consider(&nearest, *name);
    if (nearest.name)
        return config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                              "there is no such section; did you mean [%s%s]?", nearest.name,
                              g_str_equal(nearest.name, "rig") ? "" : " NAME");
    return config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                          "there is no such section; a rig file has [rig], [axis NAME], [lamps "
                          "NAME], [lamp NAME], [camera NAME], [laser NAME], [interlock NAME] and "
                          "[mark NAME]");
}

/* Axes that nothing uses are misspelt ones. */
static gboolean devices_layout_uses(const struct layout *layout,
                                    const struct config_section *axis) {
    for (int i = 0; i < layout->geometry.n_lasers; i++)
        if (layout->sweeps[i] == axis)
            return TRUE;
    return axis == layout->turntable || axis == layout->arc;
}

/* lasers: all were understood, so that they say which axes they use. */
static void check_whole(const struct layout *layout, gboolean lasers, Mistakes *mistakes) {
    const struct rig *rig = &layout->geometry;
    const struct {
        gboolean there;
        const char *what;
    } needed[] = {
        {rig->n_cameras > 0, "[camera NAME]"},
        {rig->n_lamps + rig->n_lasers > 0, "[lamp NAME] or [laser NAME]"},
    };
    gsize n;
    const struct config_section *sections = config_sections(layout->config, &n);

    for (gsize i = 0; i < n; i++) {
        const struct config_section *section = &sections[i];
        const char *driver = config_value(section, "driver", NULL);
        if (section->broken)
            continue;
        if (lasers && layout->has_all_sections && g_str_equal(section->class_name, "axis") &&
            !devices_layout_uses(layout, section))
            config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                           "nothing uses this axis: it is neither turntable nor arc, and no laser "
                           "names it as its sweep");
        /* Virtual time would run ahead of a real device. */
        if (layout->virtual_clock && driver && !g_str_has_prefix(driver, "sim-") &&
            drivers_by_name(section))
            config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "driver",
                           "%s is a real device and cannot keep virtual time; write clock = real "
                           "in [rig]",
                           driver);
    }
    for (gsize i = 0; layout->has_all_sections && i < G_N_ELEMENTS(needed); i++)
        if (!needed[i].there)
            config_lacks(mistakes, layout->config,
                         "there is no section %s; a rig needs cameras, and lamps or lasers",
                         needed[i].what);
}

/* Axes, banks and interlocks first: lamps and lasers name them. */
static gboolean layout_take(struct layout *layout, Config *config, Mistakes *mistakes,
                            GError **error) {
    gsize n;
    gboolean lasers = TRUE;

    memset(layout, 0, sizeof *layout);
    if ((layout->config = config)) {
        const struct config_section *sections = config_sections(config, &n);
        g_autofree gboolean *known = g_new0(gboolean, n + 1);
        layout->has_all_sections = config_has_all_sections(config);
        for (gsize i = 0; i < n; i++)
            known[i] = !sections[i].broken && check_class(layout, &sections[i], mistakes);
        for (gsize i = 0; i < n; i++)
            if (known[i])
                take_section(layout, &sections[i], mistakes);
        devices_layout_read_rig(layout, mistakes);
        for (gsize i = 0; i < n; i++)
            if (known[i] && !devices_layout_take_place(layout, &sections[i], mistakes))
                lasers &= !g_str_equal(sections[i].class_name, "laser");
        check_whole(layout, lasers, mistakes);
    }
    if (mistakes_report(mistakes, error))
        return TRUE;
    layout_clear(layout);
    return FALSE;
}

gboolean layout_load(struct layout *layout, const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    return layout_take(layout, config_load_checked(path, mistakes), mistakes, error);
}

gboolean layout_parse(struct layout *layout, const char *text, const char *path, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    return layout_take(layout, config_parse_checked(text, path, mistakes), mistakes, error);
}

void layout_clear(struct layout *layout) {
    g_clear_pointer(&layout->config, config_free);
    g_clear_pointer(&layout->calibration_path, g_free);
}
