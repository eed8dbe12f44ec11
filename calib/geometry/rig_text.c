/* The key file of a rig. Tables of fields map struct members to keys with their bounds; names of
 * sections and keys are the file format and must not change. */
#include "fields.h"
#include "rig.h"

#include <stddef.h>
#include <string.h>

#define FORMAT         "mesorig-calibration-1"
#define UNIT_TOLERANCE 1e-6

G_DEFINE_QUARK(rig_error, rig_error)

/* The counts of devices come first, in the order of devices[]. */
static const struct field rig_fields[] = {
    {"cameras", offsetof(struct rig, n_cameras), 1, TRUE, 0, RIG_MAX_CAMERAS},
    {"lamps", offsetof(struct rig, n_lamps), 1, TRUE, 0, RIG_MAX_LAMPS},
    {"lasers", offsetof(struct rig, n_lasers), 1, TRUE, 0, RIG_MAX_LASERS},
    {"marks", offsetof(struct rig, n_fiducials), 1, TRUE, 0, RIG_MAX_FIDUCIALS, TRUE},
    {"arc_radius_mm", offsetof(struct rig, arc_radius_mm), 1, FALSE, 0, FIELD_LARGE},
    {"arc_width_mm", offsetof(struct rig, arc_width_mm), 1, FALSE, 0, FIELD_LARGE},
    {"arc_zero_rad", offsetof(struct rig, arc.zero_rad), 1, FALSE, -G_PI, G_PI, TRUE},
    {"arc_tilt_rad", offsetof(struct rig, arc.tilt_rad), 2, FALSE, -1, 1, TRUE},
    {"arc_centre_mm", offsetof(struct rig, arc.centre_mm), 2, FALSE, -FIELD_LARGE, FIELD_LARGE,
     TRUE},
    {"arm_axis", offsetof(struct rig, arm.axis), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE,
     TRUE, TRUE},
    {"arm_centre_mm", offsetof(struct rig, arm.centre_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE,
     TRUE, TRUE},
    {"probe_axis", offsetof(struct rig, probe.axis), 3, FALSE, -1 - UNIT_TOLERANCE,
     1 + UNIT_TOLERANCE, TRUE, TRUE},
    {"probe_centre_mm", offsetof(struct rig, probe.centre_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE,
     TRUE, TRUE},
    {"turntable_wobble_rad", offsetof(struct rig, wobble.rad), 4 * RIG_WOBBLE_HARMONICS, FALSE,
     -RIG_MAX_WOBBLE_RAD, RIG_MAX_WOBBLE_RAD, TRUE, TRUE},
    {NULL},
};

#define CAMERA(member) offsetof(struct rig_camera, member)
static const struct field camera_fields[] = {
    {"width", CAMERA(width), 1, TRUE, 1, 65536},
    {"height", CAMERA(height), 1, TRUE, 1, 65536},
    {"fx_px", CAMERA(fx_px), 1, FALSE, 1e-3, FIELD_LARGE},
    {"fy_px", CAMERA(fy_px), 1, FALSE, 1e-3, FIELD_LARGE},
    {"cx_px", CAMERA(cx_px), 1, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"cy_px", CAMERA(cy_px), 1, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"k1", CAMERA(k1), 1, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"k2", CAMERA(k2), 1, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"k3", CAMERA(k3), 1, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"p1", CAMERA(p1), 1, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"p2", CAMERA(p2), 1, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"lens", CAMERA(lens), 1, TRUE, 0, RIG_LENSES - 1, TRUE, TRUE},
    {"k4", CAMERA(k4), 1, FALSE, -FIELD_LARGE, FIELD_LARGE, TRUE, TRUE},
    {"k5", CAMERA(k5), 1, FALSE, -FIELD_LARGE, FIELD_LARGE, TRUE, TRUE},
    {"k6", CAMERA(k6), 1, FALSE, -FIELD_LARGE, FIELD_LARGE, TRUE, TRUE},
    {"lateral_colour", CAMERA(lateral_colour), 3, FALSE, -RIG_MAX_LATERAL, RIG_MAX_LATERAL, TRUE,
     TRUE},
    {"rotation", CAMERA(rotation), 9, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"translation_mm", CAMERA(translation_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"vignetting", CAMERA(vignetting), 1, FALSE, -1, 1},
    {"response", CAMERA(response), 1, FALSE, RIG_MIN_RESPONSE, RIG_MAX_RESPONSE},
    {"on_arm", CAMERA(on_arm), 1, TRUE, 0, 1, TRUE, TRUE},
    {"arm_deg", CAMERA(arm_deg), 1, FALSE, -360, 360, TRUE, TRUE},
    {"stop", CAMERA(stop), 1, TRUE, 0, RIG_MAX_CAMERAS - 1, TRUE, TRUE},
    {NULL},
};

#define LAMP(member) offsetof(struct rig_lamp, member)
static const struct field lamp_fields[] = {
    {"position_mm", LAMP(position_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"aim", LAMP(aim), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"exponent", LAMP(exponent), 1, FALSE, 0, 1e6},
    {"intensity", LAMP(intensity), 1, FALSE, G_MINDOUBLE, RIG_MAX_INTENSITY},
    {"fixed", LAMP(fixed), 1, TRUE, 0, 1, TRUE},
    {"on_probe", LAMP(on_probe), 1, TRUE, 0, 1, TRUE, TRUE},
    {"probe_deg", LAMP(probe_deg), 1, FALSE, -360, 360, TRUE, TRUE},
    {"stop", LAMP(stop), 1, TRUE, 0, RIG_MAX_LAMPS - 1, TRUE, TRUE},
    {NULL},
};

#define LASER(member) offsetof(struct rig_laser, member)
static const struct field laser_fields[] = {
    {"position_mm", LASER(position_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"axis", LASER(axis), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"normal", LASER(normal), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"stretch", LASER(stretch), 1, FALSE, -RIG_MAX_STRETCH, RIG_MAX_STRETCH, TRUE},
    {"bend_rad", LASER(bend_rad), 1, FALSE, -RIG_MAX_BEND, RIG_MAX_BEND, TRUE, TRUE},
    {"fixed", LASER(fixed), 1, TRUE, 0, 1, TRUE},
    {NULL},
};

#define FIDUCIAL(member) offsetof(struct rig_fiducial, member)
static const struct field fiducial_fields[] = {
    {"centre_mm", FIDUCIAL(centre_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"radius_mm", FIDUCIAL(radius_mm), 1, FALSE, 1e-3, FIELD_LARGE},
    {"reflectance", FIDUCIAL(reflectance), 3, FALSE, 0.01, 2},
    {NULL},
};

/* Each row describes an array of struct rig. Each element of the array has a section "[PREFIX i]".
 * The first member of an element is its name. */
static const struct {
    const char *prefix;
    gsize array, size;
    const struct field *fields;
} devices[] = {
    {"camera", offsetof(struct rig, cameras), sizeof(struct rig_camera), camera_fields},
    {"lamp", offsetof(struct rig, lamps), sizeof(struct rig_lamp), lamp_fields},
    {"laser", offsetof(struct rig, lasers), sizeof(struct rig_laser), laser_fields},
    {"mark", offsetof(struct rig, fiducials), sizeof(struct rig_fiducial), fiducial_fields},
};
#define KINDS G_N_ELEMENTS(devices)

static int rig_text_count(const struct rig *rig, gsize kind) {
    return *(const int *)((const char *)rig + rig_fields[kind].offset);
}

char *rig_to_text(const struct rig *rig) {
    GString *text = g_string_new("[rig]\nformat=" FORMAT "\n");

    fields_write_string(text, "id", rig->id);
    for (gsize k = 0; k < KINDS; k++)
        if (!rig_fields[k].optional || rig_text_count(rig, k) > 0)
            g_string_append_printf(text, "%s=%d\n", rig_fields[k].name, rig_text_count(rig, k));
    fields_write(text, rig_fields + KINDS, rig);
    for (gsize k = 0; k < KINDS; k++)
        for (int i = 0; i < rig_text_count(rig, k); i++) {
            const char *device = (const char *)rig + devices[k].array + (gsize)i * devices[k].size;
            g_string_append_printf(text, "\n[%s %d]\n", devices[k].prefix, i);
            fields_write_string(text, "name", device);
            fields_write(text, devices[k].fields, device);
        }
    g_string_append(text, "\n[end]\ncomplete=yes\n");
    return g_string_free(text, FALSE);
}

static gboolean is_unit(struct vec3 v) {
    return fabs(vec3_length(v) - 1) < UNIT_TOLERANCE;
}

/* Returns whether the rows have unit length, are perpendicular, and row₀ × row₁ = row₂. */
static gboolean is_rotation(const struct mat3 *m) {
    struct vec3 row[3];

    for (int i = 0; i < 3; i++)
        row[i] = vec3(m->m[i][0], m->m[i][1], m->m[i][2]);
    return is_unit(row[0]) && is_unit(row[1]) && fabs(vec3_dot(row[0], row[1])) < UNIT_TOLERANCE &&
           vec3_length(vec3_sub(vec3_cross(row[0], row[1]), row[2])) < 4 * UNIT_TOLERANCE;
}

/* Sets an error about a key of the section "[kind i]", such as [camera 0]. Returns FALSE. */
static gboolean refuse_device(const char *path, const char *kind, int i, const char *key,
                              GError **error, const char *why) {
    g_autofree char *group = g_strdup_printf("%s %d", kind, i);
    return fields_refuse(path, group, key, error, why);
}

/* Refuses a section of a device whose number is not below the count of such devices in [rig]. Such
 * a file was edited by hand. Other sections are ignored. */
static gboolean rig_text_check_groups(GKeyFile *file, const char *path, const struct rig *rig,
                                      GError **error) {
    g_auto(GStrv) groups = g_key_file_get_groups(file, NULL);

    for (char **group = groups; *group; group++)
        for (gsize k = 0; k < KINDS; k++) {
            const gsize length = strlen(devices[k].prefix);
            guint64 index;
            if (!g_str_has_prefix(*group, devices[k].prefix) || (*group)[length] != ' ' ||
                !g_ascii_string_to_unsigned(*group + length + 1, 10, 0, G_MAXINT, &index, NULL) ||
                index < (guint64)rig_text_count(rig, k))
                continue;
            g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                        "%s: [%s] is not among the %d sections that [rig] %s counts; correct %s in "
                        "[rig], or remove [%s]",
                        path, *group, rig_text_count(rig, k), rig_fields[k].name,
                        rig_fields[k].name, *group);
            return FALSE;
        }
    return TRUE;
}

static gboolean rig_text_read_rig(GKeyFile *file, const char *path, struct rig *rig,
                                  GError **error) {
    static const char *const others[] = {"format", "id", NULL}, *const name[] = {"name", NULL};

    if (!fields_read_name(file, path, "rig", "id", rig->id, sizeof rig->id, error) ||
        !fields_read(file, path, "rig", rig_fields, others, rig, error) ||
        !rig_text_check_groups(file, path, rig, error))
        return FALSE;
    for (gsize k = 0; k < KINDS; k++)
        for (int i = 0; i < rig_text_count(rig, k); i++) {
            char *device = (char *)rig + devices[k].array + (gsize)i * devices[k].size;
            g_autofree char *group = g_strdup_printf("%s %d", devices[k].prefix, i);
            if (!fields_read_name(file, path, group, "name", device, RIG_NAME, error) ||
                !fields_read(file, path, group, devices[k].fields, name, device, error))
                return FALSE;
        }
    /* Checks rotations, numbers of stops, and unit vectors. */
    for (int i = 0; i < rig->n_cameras; i++)
        if (!is_rotation(&rig->cameras[i].rotation))
            return refuse_device(path, "camera", i, "rotation", error,
                                 "is not a rotation matrix; calibrate again or restore the file");
    for (int i = 0; i < rig->n_cameras; i++)
        if (rig->cameras[i].stop > (i > 0 ? rig->cameras[i - 1].stop + 1 : 0))
            return refuse_device(path, "camera", i, "stop", error,
                                 "does not follow the number of the previous stop of the camera; "
                                 "calibrate again or restore the file");
    for (int i = 0; i < rig->n_lamps; i++)
        if (rig->lamps[i].stop > (i > 0 ? rig->lamps[i - 1].stop + 1 : 0))
            return refuse_device(path, "lamp", i, "stop", error,
                                 "does not follow the number of the previous stop of the lamp; "
                                 "calibrate again or restore the file");
    for (int i = 0; i < rig->n_lamps; i++)
        if (!is_unit(rig->lamps[i].aim))
            return refuse_device(path, "lamp", i, "aim", error,
                                 "is not a unit vector; calibrate again or restore the file");
    for (int i = 0; i < rig->n_lasers; i++) {
        const struct rig_laser *laser = &rig->lasers[i];
        if (!is_unit(laser->axis) || !is_unit(laser->normal) ||
            fabs(vec3_dot(laser->axis, laser->normal)) > UNIT_TOLERANCE)
            return refuse_device(
                path, "laser", i, "axis and normal", error,
                "are not perpendicular unit vectors; calibrate again or restore the file");
    }
    return TRUE;
}

/* Returns the number, from 1, of the first line that is neither empty, a comment, a [group] nor
 * key=value, or 0 if there is none. The parser's own message is not shown, because it quotes the
 * line, and the path may name a file that only this program may read. */
static int rig_text_bad_line(const char *text) {
    g_auto(GStrv) lines = g_strsplit(text, "\n", -1);

    for (int i = 0; lines[i]; i++) {
        const char *line = g_strstrip(lines[i]);
        const gboolean group = *line == '[' && g_str_has_suffix(line, "]");
        if (*line && *line != '#' && *line != '=' && !group && !strchr(line, '='))
            return i + 1;
    }
    return 0;
}

gboolean rig_from_text(struct rig *rig, const char *text, const char *path, GError **error) {
    g_autoptr(GKeyFile) file = g_key_file_new();
    struct rig read = {0};

    path = path ? path : "calibration";
    if (!g_key_file_load_from_data(file, text, strlen(text), G_KEY_FILE_NONE, NULL)) {
        const int line = rig_text_bad_line(text);
        g_autofree char *what =
            line > 0 ? g_strdup_printf("line %d is", line) : g_strdup("one of its lines is");
        g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                    "%s: this is not a calibration file: %s neither a [section] nor key=value; "
                    "correct the line, or give the right file",
                    path, what);
        return FALSE;
    }
    g_autofree char *format = g_key_file_get_string(file, "rig", "format", NULL);
    g_autofree char *end = g_key_file_get_string(file, "end", "complete", NULL);
    if (g_strcmp0(format, FORMAT) != 0) {
        g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                    "%s: [rig] format: is '%s', not '" FORMAT
                    "'; this is not a calibration file of this version; give the right file, or "
                    "calibrate again",
                    path, format ? format : "");
        return FALSE;
    }
    if (g_strcmp0(end, "yes") != 0) { /* a truncated file lacks its last section */
        g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                    "%s: the file is cut short; restore it or calibrate again", path);
        return FALSE;
    }
    if (!rig_text_read_rig(file, path, &read, error))
        return FALSE;
    *rig = read;
    return TRUE;
}
