#include "devices_private.h"

#include "base/nearest.h"
#include "devices_options.h"
#include "geometry/swing.h"
#include "lamp_places.h"

#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))

static const char **names_of(const struct option *options, const char *first) {
    GPtrArray *names = g_ptr_array_new();

    if (first)
        g_ptr_array_add(names, (gpointer)first);
    for (; options && options->name; options++)
        g_ptr_array_add(names, (gpointer)options->name);
    g_ptr_array_add(names, NULL);
    return (const char **)g_ptr_array_free(names, FALSE);
}

const char **layout_keys(const char *class_name) {
    return names_of(devices_section_options(class_name), NULL);
}

const struct layout_device *layout_device(const struct layout *layout,
                                          const struct config_section *section) {
    for (guint i = 0; i < layout->devices->len; i++) {
        const struct layout_device *device =
            &g_array_index(layout->devices, struct layout_device, i);
        if (device->section == section)
            return device;
    }
    return NULL;
}

static void keep_device(struct layout *layout, const struct config_section *section,
                        const struct driver_info *info, gpointer fields) {
    const struct layout_device device = {section, info, fields};
    g_array_append_val(layout->devices, device);
}

/* Reads the options of the driver and the keys of the rig (place) from a section, without
 * opening the device. If the driver is not known, only the keys of the rig are checked. Returns
 * whether all of them were read; the caller then clears place with options_clear(). */
static gboolean read_device(struct layout *layout, const struct config_section *section,
                            gpointer place, Mistakes *mistakes) {
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
    g_autofree gpointer fields = g_malloc0(MAX(info->priv_size, 1));
    const struct option_target both[] = {{info->options, fields}, ours};
    if (!options_read(both, options ? 2 : 1, section, only_driver, mistakes)) {
        /* The mistake may be in a key of the rig. If the options of the driver are right, the
         * section is kept, so that check_needs() can check it. */
        g_autoptr(Mistakes) known = mistakes_new();
        if (options_read(both, 1, section, any, known))
            keep_device(layout, section, info, g_steal_pointer(&fields));
        return FALSE;
    }
    if (info->check && layout->checks_drivers)
        info->check(fields, section, mistakes);
    keep_device(layout, section, info, g_steal_pointer(&fields));
    return TRUE;
}

static gboolean read_rig(struct layout *layout, Mistakes *mistakes) {
    const struct config_section *section = config_find(layout->config, "rig", NULL);
    struct rig_fields fields = {0};

    if (!section || section->name)
        return layout->has_all_sections
                   ? config_lacks(mistakes, layout->config, "there is no section [rig]; add it")
                   : FALSE;
    if (!options_read(&(struct option_target){devices_rig_options, &fields}, 1, section, NULL,
                      mistakes))
        return FALSE;
    gboolean ok = *fields.id && strlen(fields.id) < sizeof layout->geometry.id;
    if (ok)
        g_strlcpy(layout->geometry.id, fields.id, sizeof layout->geometry.id);
    else
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "id",
                       "has %zu bytes, but must have 1 to %d", strlen(fields.id),
                       (int)sizeof layout->geometry.id - 1);
    if (layout->arc && fields.arc_radius_mm == 0)
        ok = config_mistake(mistakes, CONFIG_ERROR_MISSING, section, "arc_radius_mm",
                            "must be given, because there is an [axis arc]");
    layout->geometry.arc_radius_mm = fields.arc_radius_mm;
    layout->geometry.arc_width_mm = fields.arc_width_mm;
    if (layout->arm)
        layout->geometry.arm.axis =
            rig_direction(RAD(fields.arm_axis_theta_deg), RAD(fields.arm_axis_phi_deg));
    if (layout->probe)
        layout->geometry.probe.axis =
            rig_direction(RAD(fields.probe_axis_theta_deg), RAD(fields.probe_axis_phi_deg));
    layout->virtual_clock = fields.clock == 1;
    layout->calibration_days = fields.calibration_days;
    if (*fields.calibration) {
        g_autofree char *folder = g_path_get_dirname(config_path(layout->config));
        layout->calibration_path = g_canonicalize_filename(fields.calibration, folder);
    }
    options_clear(devices_rig_options, &fields);
    return ok;
}

static gboolean count_up(int *n, int most, const struct config_section *section,
                         Mistakes *mistakes) {
    if (*n < most) {
        (*n)++;
        return TRUE;
    }
    return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                          "there are too many sections of this class: at most %d are allowed (each "
                          "stop of a camera or lamp counts as one)",
                          most);
}

static gboolean take_name(const struct config_section *section, char to[RIG_NAME],
                          Mistakes *mistakes) {
    if (strlen(section->name) < RIG_NAME) {
        g_strlcpy(to, section->name, RIG_NAME);
        return TRUE;
    }
    return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                          "the name has %zu bytes, but at most %d are allowed",
                          strlen(section->name), RIG_NAME - 1);
}

static struct vec3 position(const struct place_fields *place) {
    return vec3_scale(rig_direction(RAD(place->theta_deg), RAD(place->phi_deg)),
                      place->distance_mm);
}

/* Sets *ret_fixed to whether a lamp or laser is fixed. It is fixed if its azimuth is given, or if
 * there is no arc.
 *
 * Without an arc, the azimuth may be left out only for a lamp or laser overhead, where every
 * azimuth is the same position. In any other position, returns FALSE and reports that the azimuth
 * is missing. If the heading of another section is wrong, this section may be the one of the arc.
 * Then nothing is reported. */
static gboolean take_carrier(const struct layout *layout, const struct config_section *section,
                             const struct place_fields *place, int *ret_fixed, Mistakes *mistakes) {
    const gboolean given = config_value(section, "phi_deg", NULL) != NULL;

    *ret_fixed = given || !layout->arc;
    if (given || layout->arc || place->theta_deg == 0)
        return TRUE;
    return layout->has_all_sections
               ? config_mistake(
                     mistakes, CONFIG_ERROR_MISSING, section, "phi_deg",
                     "must be given, because there is no [axis arc] to carry this device")
               : FALSE;
}

/* Checks the stops of a camera or lamp that is carried by the arm or the probe: the axis must
 * exist, and no angle may be given twice. */
static gboolean check_stops(const struct layout *layout, const struct config_section *section,
                            const char *key, const struct config_section *axis, const char *name,
                            const struct option_doubles *stops, Mistakes *mistakes) {
    if (!axis)
        return layout->has_all_sections
                   ? config_mistake(mistakes, CONFIG_ERROR_MISSING, section, key,
                                    "there is no section [axis %s] to carry this device; add that "
                                    "section, or remove this key",
                                    name)
                   : FALSE;
    for (int i = 0; i < stops->n; i++)
        for (int k = 0; k < i; k++)
            if (stops->values[i] == stops->values[k])
                return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                                      "%g is given twice: name each stop once", stops->values[i]);
    return TRUE;
}

/* Sets the name of a stop, "NAME@ANGLE", and checks that its position is above the turntable. */
static gboolean take_stop(const struct config_section *section, const char *key, double deg,
                          struct vec3 position_mm, char to[RIG_NAME], Mistakes *mistakes) {
    g_autofree char *name = g_strdup_printf("%s@%g", section->name, deg);

    if (strlen(name) >= RIG_NAME)
        return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, NULL,
                              "the name of a stop, %s, has more than %d bytes: give the section a "
                              "shorter name",
                              name, RIG_NAME - 1);
    g_strlcpy(to, name, RIG_NAME);
    return position_mm.z > 0 ||
           config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                          "the stop at %g° would be below the turntable's top; "
                          "correct the angle, or the direction of the axis in [rig]",
                          deg);
}

/* Makes a camera of the geometry for each stop, from index i on. Camera i must have the position
 * that it has with the arm at 0. */
static gboolean add_camera_stops(struct layout *layout, const struct config_section *section, int i,
                                 const struct option_doubles *stops, Mistakes *mistakes) {
    struct rig *rig = &layout->geometry;
    const struct rig_camera at_0 = rig->cameras[i];
    gboolean ok = check_stops(layout, section, "arm_deg", layout->arm, "arm", stops, mistakes);

    for (int k = 0; ok && k < stops->n; k++) {
        if (k > 0 && !count_up(&rig->n_cameras, RIG_MAX_CAMERAS, section, mistakes))
            return FALSE;
        struct rig_camera *camera = &rig->cameras[i + k];
        *camera = at_0;
        camera->on_arm = 1;
        camera->arm_deg = stops->values[k];
        camera->stop = k;
        rig_swing_camera(&rig->arm, RAD(camera->arm_deg), camera);
        layout->cameras[i + k] = section;
        ok = take_stop(section, "arm_deg", camera->arm_deg, rig_camera_centre_mm(camera),
                       camera->name, mistakes);
    }
    return ok;
}

static gboolean add_lamp_stops(struct layout *layout, const struct config_section *section, int i,
                               const struct option_doubles *stops, Mistakes *mistakes) {
    struct rig *rig = &layout->geometry;
    const struct rig_lamp at_0 = rig->lamps[i];
    gboolean ok =
        check_stops(layout, section, "probe_deg", layout->probe, "probe", stops, mistakes);

    for (int k = 0; ok && k < stops->n; k++) {
        if (k > 0 && !count_up(&rig->n_lamps, RIG_MAX_LAMPS, section, mistakes))
            return FALSE;
        struct rig_lamp *lamp = &rig->lamps[i + k];
        *lamp = at_0;
        lamp->on_probe = 1;
        lamp->probe_deg = stops->values[k];
        lamp->stop = k;
        lamp->position_mm = rig_swing_point(&rig->probe, RAD(lamp->probe_deg), at_0.position_mm);
        lamp->aim = rig_swing_direction(&rig->probe, RAD(lamp->probe_deg), at_0.aim);
        layout->lamps[i + k] = section;
        layout->lamp_bank[i + k] = layout->lamp_bank[i];
        layout->lamp_index[i + k] = layout->lamp_index[i];
        ok = take_stop(section, "probe_deg", lamp->probe_deg, lamp->position_mm, lamp->name,
                       mistakes);
    }
    return ok;
}

static gboolean read_camera(struct layout *layout, const struct config_section *section,
                            Mistakes *mistakes) {
    struct rig *rig = &layout->geometry;
    struct place_fields p = {0};
    int i = rig->n_cameras;

    if (!count_up(&rig->n_cameras, RIG_MAX_CAMERAS, section, mistakes))
        return FALSE;
    const gboolean named = take_name(section, rig->cameras[i].name, mistakes);
    if (!read_device(layout, section, &p, mistakes))
        return FALSE;
    if (!named) {
        options_clear(devices_camera_options, &p);
        return FALSE;
    }
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
    rig_camera_look_at(camera, position(&p), vec3(0, 0, 0));
    if (p.theta_deg ==
        0) /* overhead, the azimuth is the rotation about the camera's optical axis */
        for (int k = 0; k < 2; k++) {
            double *row = camera->rotation.m[k];
            const struct vec3 turned = rig_turn(vec3(row[0], row[1], row[2]), RAD(p.phi_deg));
            row[0] = turned.x, row[1] = turned.y, row[2] = turned.z;
        }
    layout->cameras[i] = section;
    const gboolean ok = !config_value(section, "arm_deg", NULL) ||
                        add_camera_stops(layout, section, i, &p.arm_deg, mistakes);
    options_clear(devices_camera_options, &p);
    return ok;
}

/* Wires lamp i to a lamp of a bank. key is the key of the lamp's section that gives the index. */
static gboolean wire_lamp(struct layout *layout, int i, int bank, int index, const char *key,
                          Mistakes *mistakes) {
    for (int k = 0; k < i; k++)
        if (layout->lamp_bank[k] == bank && layout->lamp_index[k] == index)
            return config_mistake(
                mistakes, CONFIG_ERROR_VALUE, layout->lamps[i], key,
                "lamp %d of %s is already used for the lamp %s, in line %d; correct one of the "
                "two",
                index, layout->banks[bank].section->name, layout->geometry.lamps[k].name,
                layout->lamps[k]->line);
    layout->lamp_bank[i] = bank;
    layout->lamp_index[i] = index;
    return TRUE;
}

static gboolean wire_to(struct layout *layout, int i, const struct place_fields *p,
                        Mistakes *mistakes) {
    for (int bank = 0; bank < layout->n_banks; bank++)
        if (g_str_equal(layout->banks[bank].section->name, p->bank))
            return wire_lamp(layout, i, bank, p->index, "index", mistakes);
    return layout->has_all_sections
               ? config_mistake(mistakes, CONFIG_ERROR_MISSING, layout->lamps[i], "bank",
                                "there is no section [lamps %s]; name an existing one", p->bank)
               : FALSE;
}

/* Sets position, exponent and intensity, and aims the lamp at the middle of the turntable's top. */
static void place_lamp(struct rig_lamp *lamp, const struct place_fields *p) {
    lamp->position_mm = position(p);
    lamp->aim = vec3_scale(vec3_unit(lamp->position_mm), -1);
    lamp->exponent = p->exponent;
    lamp->intensity = p->intensity;
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
    const gboolean named = take_name(section, rig->lamps[i].name, mistakes);
    if (!options_read(&(struct option_target){devices_lamp_options, &p}, 1, section, NULL,
                      mistakes))
        return FALSE;
    const gboolean carried = take_carrier(layout, section, &p, &rig->lamps[i].fixed, mistakes);
    const gboolean wired = wire_to(layout, i, &p, mistakes);
    place_lamp(&rig->lamps[i], &p);
    const gboolean stops = !config_value(section, "probe_deg", NULL) ||
                           add_lamp_stops(layout, section, i, &p.probe_deg, mistakes);
    options_clear(devices_lamp_options, &p);
    return named && carried && wired && stops;
}

/* Adds the lamps that the section of a bank places, as if each had a section [lamp NAME]. */
static gboolean read_bank_lamps(struct layout *layout, int bank, Mistakes *mistakes) {
    const struct config_section *section = layout->banks[bank].section;
    const GArray *places = layout->banks[bank].places;
    const char *key = lamp_places_key(section);
    struct rig *rig = &layout->geometry;

    for (guint k = 0; places && k < places->len; k++) {
        const struct lamp_place *place = &g_array_index(places, struct lamp_place, k);
        const struct place_fields p = {.theta_deg = place->theta_deg,
                                       .phi_deg = place->phi_deg,
                                       .distance_mm = place->distance_mm,
                                       .exponent = place->exponent,
                                       .intensity = place->intensity};
        const int i = rig->n_lamps;
        if (i == RIG_MAX_LAMPS)
            return config_mistake(mistakes, CONFIG_ERROR_VALUE, section, key,
                                  "with the lamps before it, the rig has more than %d lamps, which "
                                  "is the maximum",
                                  RIG_MAX_LAMPS);
        rig->n_lamps++;
        layout->lamps[i] = section;
        layout->lamp_bank[i] = -1;
        g_strlcpy(rig->lamps[i].name, place->name, RIG_NAME);
        place_lamp(&rig->lamps[i], &p);
        rig->lamps[i].fixed =
            1; /* take_carrier() below clears this for lamps that [axis arc] carries */
        if ((g_str_equal(key, "theta_deg") &&
             !take_carrier(layout, section, &p, &rig->lamps[i].fixed, mistakes)) ||
            !wire_lamp(layout, i, bank, place->index,
                       config_value(section, "first_index", NULL) ? "first_index" : key, mistakes))
            return FALSE;
    }
    return TRUE;
}

static gboolean read_bank(struct layout *layout, const struct config_section *section,
                          Mistakes *mistakes) {
    struct layout_bank *bank = &layout->banks[layout->n_banks];
    struct bank_fields fields = {0};

    if (!count_up(&layout->n_banks, DEVICES_MAX_BANKS, section, mistakes))
        return FALSE;
    bank->section = section;
    if (!read_device(layout, section, &fields, mistakes))
        return FALSE;
    bank->places = lamp_places_new(&fields, section, mistakes);
    options_clear(devices_bank_options, &fields);
    return bank->places != NULL;
}

/* Reports a lamp with the name of an earlier one. Two sections never have the same name, but names
 * of lamps that the section of a bank places may equal others. */
static void check_lamp_names(const struct layout *layout, Mistakes *mistakes) {
    const struct rig *rig = &layout->geometry;
    g_autoptr(GHashTable) names = g_hash_table_new(g_str_hash, g_str_equal);

    for (int i = 0; i < rig->n_lamps; i++) {
        const int before = GPOINTER_TO_INT(g_hash_table_lookup(names, rig->lamps[i].name)) - 1;
        if (before >= 0 && *rig->lamps[i].name)
            config_mistake(mistakes, CONFIG_ERROR_VALUE, layout->lamps[i],
                           lamp_places_key(layout->lamps[i]),
                           "a lamp with the name %s is already in line %d; rename one of the two",
                           rig->lamps[i].name, layout->lamps[before]->line);
        else
            g_hash_table_insert(names, (gpointer)rig->lamps[i].name, GINT_TO_POINTER(i + 1));
    }
}

/* Returns whether an axis is the turntable, arc, arm or probe, and not the sweep of a laser. */
static gboolean is_positioner(const struct layout *layout, const struct config_section *axis) {
    return axis == layout->turntable || axis == layout->arc || axis == layout->arm ||
           axis == layout->probe;
}

static gboolean wire_laser(struct layout *layout, int i, const char *sweep, Mistakes *mistakes) {
    const struct config_section *axis = config_find(layout->config, "axis", sweep);

    if (axis && !is_positioner(layout, axis)) {
        layout->sweeps[i] = axis;
        return TRUE;
    }
    if (!axis && !layout->has_all_sections)
        return FALSE;
    return config_mistake(
        mistakes, CONFIG_ERROR_MISSING, layout->lasers[i], "sweep",
        axis ? "the axis \"%s\" does not sweep a laser; give the laser a separate axis"
             : "there is no section [axis %s]; name the axis that sweeps the line",
        sweep);
}

/* Adds a further mount position of a laser that is described earlier in the file. */
static gboolean wire_mount(struct layout *layout, int i, const char *name, Mistakes *mistakes) {
    int unit = i - 1;

    while (unit >= 0 && !g_str_equal(layout->lasers[unit]->name, name))
        unit--;
    if (unit >= 0 && layout->unit[unit] == unit) {
        layout->unit[i] = unit;
        layout->sweeps[i] = layout->sweeps[unit];
        return TRUE;
    }
    if (unit < 0 && !layout->has_all_sections)
        return FALSE;
    return config_mistake(
        mistakes, CONFIG_ERROR_MISSING, layout->lasers[i], "mount_of",
        unit >= 0 ? "\"%s\" is itself only a mount position; name the laser that is mounted there"
                  : "there is no section [laser %s] before this one; name the laser "
                    "that is mounted here, and put its section first",
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
    const gboolean named = take_name(section, laser->name, mistakes);
    const gboolean mounted = config_value(section, "mount_of", NULL) != NULL;
    if (!(mounted ? options_read(&(struct option_target){devices_mount_options, &p}, 1, section,
                                 NULL, mistakes)
                  : read_device(layout, section, &p, mistakes)))
        return FALSE;
    const gboolean wired = mounted ? wire_mount(layout, i, p.mount_of, mistakes)
                                   : wire_laser(layout, i, p.sweep, mistakes);
    const gboolean carried = take_carrier(layout, section, &p, &laser->fixed, mistakes);
    const gboolean ok = named && wired && carried;
    if (ok) {
        laser->position_mm = position(&p);
        laser->axis = rig_turn(vec3(0, 1, 0), RAD(p.phi_deg));
        laser->normal = vec3_unit(vec3_cross(laser->axis, vec3_scale(laser->position_mm, -1)));
    }
    options_clear(devices_laser_options, &p);
    return ok;
}

static gboolean read_mark(struct layout *layout, const struct config_section *section,
                          Mistakes *mistakes) {
    struct rig *rig = &layout->geometry;
    struct mark_fields p = {0};
    int i = rig->n_fiducials;

    if (!count_up(&rig->n_fiducials, RIG_MAX_FIDUCIALS, section, mistakes))
        return FALSE;
    const gboolean named = take_name(section, rig->fiducials[i].name, mistakes);
    if (!options_read(&(struct option_target){devices_mark_options, &p}, 1, section, NULL,
                      mistakes))
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
    options_clear(devices_mark_options, &p);
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
        if (g_str_equal(section->name, "arm"))
            layout->arm = section;
        if (g_str_equal(section->name, "probe"))
            layout->probe = section;
        return read_device(layout, section, &fields, mistakes);
    }
    if (g_str_equal(section->class_name, "lamps"))
        return read_bank(layout, section, mistakes);
    if (g_str_equal(section->class_name, "interlock")) {
        layout->interlocks[MIN(layout->n_interlocks, DEVICES_MAX_INTERLOCKS - 1)] = section;
        return count_up(&layout->n_interlocks, DEVICES_MAX_INTERLOCKS, section, mistakes) &&
               read_device(layout, section, NULL, mistakes);
    }
    return TRUE;
}

static gboolean take_place(struct layout *layout, const struct config_section *section,
                           Mistakes *mistakes) {
    if (g_str_equal(section->class_name, "camera"))
        return read_camera(layout, section, mistakes);
    if (g_str_equal(section->class_name, "lamp"))
        return read_lamp(layout, section, mistakes);
    for (int i = 0; i < layout->n_banks; i++)
        if (layout->banks[i].section == section)
            return read_bank_lamps(layout, i, mistakes);
    if (g_str_equal(section->class_name, "laser"))
        return read_laser(layout, section, mistakes);
    if (g_str_equal(section->class_name, "mark"))
        return read_mark(layout, section, mistakes);
    return TRUE;
}

/* Reports a section whose heading no rig file has. has_all_sections is then set to FALSE, because
 * the section that was meant may seem to be missing. */
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
                              is_rig ? "must not have a name: write [rig]%s"
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

/* Returns whether an axis is used. The name of an axis that nothing uses is probably misspelt. */
static gboolean uses(const struct layout *layout, const struct config_section *axis) {
    for (int i = 0; i < layout->geometry.n_lasers; i++)
        if (layout->sweeps[i] == axis)
            return TRUE;
    for (int i = 0; i < layout->geometry.n_cameras; i++)
        if (axis == layout->arm && layout->geometry.cameras[i].on_arm)
            return TRUE;
    for (int i = 0; i < layout->geometry.n_lamps; i++)
        if (axis == layout->probe && layout->geometry.lamps[i].on_probe)
            return TRUE;
    return axis == layout->turntable || axis == layout->arc;
}

/* Returns whether the section of any bank has a key that places lamps. The value of the key may
 * have a mistake. */
static gboolean places_lamps(const struct layout *layout) {
    for (int i = 0; i < layout->n_banks; i++)
        if (lamp_places_key(layout->banks[i].section))
            return TRUE;
    return FALSE;
}

/* Checks the file as a whole. lasers is TRUE if all laser sections were read without a mistake, so
 * that the sweep axes are known. */
static void check_whole(const struct layout *layout, gboolean lasers, Mistakes *mistakes) {
    const struct rig *rig = &layout->geometry;
    const struct {
        gboolean there;
        const char *what;
    } needed[] = {
        {rig->n_cameras > 0, "[camera NAME]"},
        {rig->n_lamps + rig->n_lasers > 0 || places_lamps(layout), "[lamp NAME] or [laser NAME]"},
    };
    gsize n;
    const struct config_section *sections = config_sections(layout->config, &n);

    for (gsize i = 0; i < n; i++) {
        const struct config_section *section = &sections[i];
        const char *driver = config_value(section, "driver", NULL);
        if (section->broken)
            continue;
        if (lasers && layout->has_all_sections && g_str_equal(section->class_name, "axis") &&
            !uses(layout, section))
            config_mistake(mistakes, CONFIG_ERROR_UNKNOWN, section, NULL,
                           "this axis is not used: it is neither turntable nor arc, no laser names "
                           "it as its sweep, and it is not an [axis arm] with cameras that have "
                           "arm_deg or an [axis probe] with lamps that have probe_deg; correct its "
                           "name, or remove the section");
        /* A real device cannot keep up with virtual time. */
        if (layout->virtual_clock && driver && !g_str_has_prefix(driver, "sim-") &&
            drivers_by_name(section))
            config_mistake(
                mistakes, CONFIG_ERROR_VALUE, section, "driver",
                "%s drives a real device, which cannot work in virtual time; write clock = real in "
                "[rig]",
                driver);
    }
    for (gsize i = 0; layout->has_all_sections && i < G_N_ELEMENTS(needed); i++)
        if (!needed[i].there)
            config_lacks(mistakes, layout->config,
                         "there is no section %s; a rig needs cameras, and lamps or lasers",
                         needed[i].what);
}

/* Reports a mistake if the device needs something exclusively (the driver's needs()) that an
 * earlier section also needs. Reports only the first conflict of a section. owners maps each thing
 * to the section that needs it. */
static void check_needs_of(const struct layout_device *device, GHashTable *owners,
                           Mistakes *mistakes) {
    g_autoptr(GPtrArray) needs = g_ptr_array_new_with_free_func(g_free);
    gboolean told = FALSE;
    device->info->needs(device->fields, needs);
    for (guint i = 0; i < needs->len; i++) {
        const struct config_section *owner = g_hash_table_lookup(owners, needs->pdata[i]);
        if (owner && owner != device->section && !told)
            told = !config_mistake(mistakes, CONFIG_ERROR_VALUE, device->section, NULL,
                                   "%s is already used by [%s], in line %d; correct one of the two",
                                   (const char *)needs->pdata[i], owner->group, owner->line);
        if (!owner)
            g_hash_table_insert(owners, g_strdup(needs->pdata[i]), (gpointer)device->section);
    }
}

/* Reports things that two sections need exclusively, for instance the same coil, relay, axis or
 * camera. */
static void check_needs(const struct layout *layout, Mistakes *mistakes) {
    g_autoptr(GHashTable) owners = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    gsize n;
    const struct config_section *sections = config_sections(layout->config, &n);
    for (gsize i = 0; i < n; i++) {
        const struct layout_device *device = layout_device(layout, &sections[i]);
        if (device && device->info->needs)
            check_needs_of(device, owners, mistakes);
    }
}

/* Axes, lamp banks and interlocks are read first, because lamps and lasers name axes and banks. */
gboolean layout_read(struct layout *layout, const char *path, const char *text,
                     gboolean checks_drivers, GError **error) {
    g_autoptr(Mistakes) mistakes = mistakes_new();
    Config *config =
        text ? config_parse_checked(text, path, mistakes) : config_load_checked(path, mistakes);
    gsize n;
    gboolean lasers = TRUE;

    *layout = (struct layout){.config = config,
                              .devices = g_array_new(FALSE, FALSE, sizeof(struct layout_device)),
                              .checks_drivers = checks_drivers};
    if (config) {
        const struct config_section *sections = config_sections(config, &n);
        g_autofree gboolean *known = g_new0(gboolean, n + 1);
        layout->has_all_sections = config_has_all_sections(config);
        for (gsize i = 0; i < n; i++)
            known[i] = !sections[i].broken && check_class(layout, &sections[i], mistakes);
        for (gsize i = 0; i < n; i++)
            if (known[i])
                take_section(layout, &sections[i], mistakes);
        read_rig(layout, mistakes);
        for (gsize i = 0; i < n; i++)
            if (known[i] && !take_place(layout, &sections[i], mistakes))
                lasers &= !g_str_equal(sections[i].class_name, "laser");
        check_lamp_names(layout, mistakes);
        check_whole(layout, lasers, mistakes);
        if (checks_drivers)
            check_needs(layout, mistakes);
    }
    if (mistakes_report(mistakes, error))
        return TRUE;
    layout_clear(layout);
    return FALSE;
}

void layout_clear(struct layout *layout) {
    for (guint i = 0; layout->devices && i < layout->devices->len; i++) {
        struct layout_device *device = &g_array_index(layout->devices, struct layout_device, i);
        options_clear(device->info->options, device->fields);
        g_free(device->fields);
    }
    for (int i = 0; i < layout->n_banks; i++)
        g_clear_pointer(&layout->banks[i].places, g_array_unref);
    g_clear_pointer(&layout->devices, g_array_unref);
    g_clear_pointer(&layout->config, config_free);
    g_clear_pointer(&layout->calibration_path, g_free);
}

/* Appends a number so that it reads back as the same double. */
static void append_number(GString *to, const char *key, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(text, sizeof text, "%.15g", value);
    if (g_ascii_strtod(text, NULL) != value)
        g_ascii_dtostr(text, sizeof text, value);
    g_string_append_printf(to, "%s = %s\n", key, text);
}

static void append_lamps(const struct layout_bank *bank, GString *to) {
    for (guint i = 0; i < bank->places->len; i++) {
        const struct lamp_place *lamp = &g_array_index(bank->places, struct lamp_place, i);
        g_string_append_printf(to, "\n[lamp %s]\nbank = %s\nindex = %d\n", lamp->name,
                               bank->section->name, lamp->index);
        append_number(to, "theta_deg", lamp->theta_deg);
        append_number(to, "phi_deg", lamp->phi_deg);
        append_number(to, "distance_mm", lamp->distance_mm);
        append_number(to, "exponent", lamp->exponent);
        append_number(to, "intensity", lamp->intensity);
    }
    g_string_append_c(to, '\n');
}

/* Returns whether a line of the file is one of the keys that place the lamps of a bank. */
static gboolean is_place_line(const struct layout_bank *bank, int line) {
    for (const struct option *option = devices_bank_options; option->name; option++) {
        int at = 0;
        config_value(bank->section, option->name, &at);
        if (at == line)
            return TRUE;
    }
    return FALSE;
}

/* The lamps stand directly after the section of their bank, so that all lamps keep their order. */
char *layout_text(const struct layout *layout) {
    GString *text = g_string_new(NULL);
    g_auto(GStrv) lines = g_strsplit(config_text(layout->config), "\n", -1);
    const struct layout_bank *within =
        NULL; /* the bank of this section if it has "positions"; otherwise NULL */
    gsize n, next = 0;
    const struct config_section *sections = config_sections(layout->config, &n);

    for (int i = 0; lines[i]; i++) {
        if (next < n && sections[next].line == i + 1) {
            if (within)
                append_lamps(within, text);
            within = NULL;
            for (int k = 0; k < layout->n_banks; k++)
                if (layout->banks[k].section == &sections[next] &&
                    config_value(&sections[next], "positions", NULL))
                    within = &layout->banks[k];
            next++;
        }
        if (!within || !is_place_line(within, i + 1))
            g_string_append_printf(text, "%s%s", lines[i], lines[i + 1] ? "\n" : "");
    }
    if (within)
        append_lamps(within, text);
    return g_string_free(text, FALSE);
}
