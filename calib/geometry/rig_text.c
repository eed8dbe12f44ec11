/* The key file of a rig. Tables of fields map struct members to keys with their bounds; names of
 * sections and keys are the file format and must not change. */
#include "fields.h"
#include "rig.h"

#include <stddef.h>
#include <string.h>

#define FORMAT         "mesorig-calibration-1"
#define UNIT_TOLERANCE 1e-6

G_DEFINE_QUARK(rig_error, rig_error)

static const struct field rig_fields[] = {
    {"arc_radius_mm", offsetof(struct rig, arc_radius_mm), 1, FALSE, 0, FIELD_LARGE},
    {"arc_width_mm", offsetof(struct rig, arc_width_mm), 1, FALSE, 0, FIELD_LARGE},
    {"arc_zero_rad", offsetof(struct rig, arc.zero_rad), 1, FALSE, -G_PI, G_PI, TRUE},
    {"arc_tilt_rad", offsetof(struct rig, arc.tilt_rad), 2, FALSE, -1, 1, TRUE},
    {"arc_centre_mm", offsetof(struct rig, arc.centre_mm), 2, FALSE, -FIELD_LARGE, FIELD_LARGE,
     TRUE},
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
    {"rotation", CAMERA(rotation), 9, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"translation_mm", CAMERA(translation_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"vignetting", CAMERA(vignetting), 1, FALSE, -1, 1},
    {"response", CAMERA(response), 1, FALSE, RIG_LEAST_RESPONSE, RIG_MOST_RESPONSE},
    {NULL},
};

#define LAMP(member) offsetof(struct rig_lamp, member)
static const struct field lamp_fields[] = {
    {"position_mm", LAMP(position_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"aim", LAMP(aim), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"exponent", LAMP(exponent), 1, FALSE, 0, 1e6},
    {"intensity", LAMP(intensity), 1, FALSE, G_MINDOUBLE, RIG_MOST_INTENSITY},
    {NULL},
};

#define LASER(member) offsetof(struct rig_laser, member)
static const struct field laser_fields[] = {
    {"position_mm", LASER(position_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"axis", LASER(axis), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"normal", LASER(normal), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"stretch", LASER(stretch), 1, FALSE, -RIG_MOST_STRETCH, RIG_MOST_STRETCH, TRUE},
    {NULL},
};

#define MARK(member) offsetof(struct rig_mark, member)
static const struct field mark_fields[] = {
    {"centre_mm", MARK(centre_mm), 3, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"radius_mm", MARK(radius_mm), 1, FALSE, 1e-3, FIELD_LARGE},
    {"reflectance", MARK(reflectance), 3, FALSE, 0.01, 2},
    {NULL},
};

static void write_device(GString *text, const char *what, int index, const char *name,
                         const struct field *fields, gconstpointer from) {
    g_string_append_printf(text, "\n[%s %d]\n", what, index);
    fields_write_string(text, "name", name);
    fields_write(text, fields, from);
}

char *rig_to_text(const struct rig *rig) {
    GString *text = g_string_new("[rig]\nformat=" FORMAT "\n");

    fields_write_string(text, "id", rig->id);
    g_string_append_printf(text, "cameras=%d\nlamps=%d\nlasers=%d\n", rig->n_cameras, rig->n_lamps,
                           rig->n_lasers);
    if (rig->n_marks > 0)
        g_string_append_printf(text, "marks=%d\n", rig->n_marks);
    fields_write(text, rig_fields, rig);
    for (int i = 0; i < rig->n_cameras; i++)
        write_device(text, "camera", i, rig->cameras[i].name, camera_fields, &rig->cameras[i]);
    for (int i = 0; i < rig->n_lamps; i++)
        write_device(text, "lamp", i, rig->lamps[i].name, lamp_fields, &rig->lamps[i]);
    for (int i = 0; i < rig->n_lasers; i++)
        write_device(text, "laser", i, rig->lasers[i].name, laser_fields, &rig->lasers[i]);
    for (int i = 0; i < rig->n_marks; i++)
        write_device(text, "mark", i, rig->marks[i].name, mark_fields, &rig->marks[i]);
    g_string_append(text, "\n[end]\ncomplete=yes\n");
    return g_string_free(text, FALSE);
}

struct reader {
    GKeyFile *file;
    const char *path;
};

static gboolean rig_text_refuse(const struct reader *r, const char *group, const char *key,
                                GError **error, const char *why) {
    return fields_refuse(r->path, group, key, error, why);
}

static gboolean rig_text_read_device(struct reader *r, const char *what, int index, char *name,
                                     const struct field *fields, gpointer to, GError **error) {
    static const char *const others[] = {"name", NULL};
    g_autofree char *group = g_strdup_printf("%s %d", what, index);

    return fields_read_name(r->file, r->path, group, "name", name, RIG_NAME, error) &&
           fields_read(r->file, r->path, group, fields, others, to, error);
}

static gboolean is_unit(struct vec3 v) {
    return fabs(vec3_length(v) - 1) < UNIT_TOLERANCE;
}

/* Rows of unit length, perpendicular, and row₀ × row₁ = row₂. */
static gboolean is_rotation(const struct mat3 *m) {
    struct vec3 row[3];

    for (int i = 0; i < 3; i++)
        row[i] = vec3(m->m[i][0], m->m[i][1], m->m[i][2]);
    return is_unit(row[0]) && is_unit(row[1]) && fabs(vec3_dot(row[0], row[1])) < UNIT_TOLERANCE &&
           vec3_length(vec3_sub(vec3_cross(row[0], row[1]), row[2])) < 4 * UNIT_TOLERANCE;
}

static gboolean check_shapes(const struct reader *r, const struct rig *rig, GError **error) {
    for (int i = 0; i < rig->n_cameras; i++)
        if (!is_rotation(&rig->cameras[i].rotation))
            return rig_text_refuse(r, rig->cameras[i].name, "rotation", error, "is not a rotation");
    for (int i = 0; i < rig->n_lamps; i++)
        if (!is_unit(rig->lamps[i].aim))
            return rig_text_refuse(r, rig->lamps[i].name, "aim", error, "is not a unit vector");
    for (int i = 0; i < rig->n_lasers; i++) {
        const struct rig_laser *laser = &rig->lasers[i];
        if (!is_unit(laser->axis) || !is_unit(laser->normal) ||
            fabs(vec3_dot(laser->axis, laser->normal)) > UNIT_TOLERANCE)
            return rig_text_refuse(r, laser->name, "axis and normal", error,
                                   "are not perpendicular unit vectors");
    }
    return TRUE;
}

static gboolean read_counts(const struct reader *r, struct rig *rig, GError **error) {
    static const struct field counts[] = {
        {"cameras", offsetof(struct rig, n_cameras), 1, TRUE, 0, RIG_MAX_CAMERAS},
        {"lamps", offsetof(struct rig, n_lamps), 1, TRUE, 0, RIG_MAX_LAMPS},
        {"lasers", offsetof(struct rig, n_lasers), 1, TRUE, 0, RIG_MAX_LASERS},
        {"marks", offsetof(struct rig, n_marks), 1, TRUE, 0, RIG_MAX_MARKS, TRUE},
        {"arc_radius_mm", offsetof(struct rig, arc_radius_mm), 1, FALSE, 0, FIELD_LARGE},
        {"arc_width_mm", offsetof(struct rig, arc_width_mm), 1, FALSE, 0, FIELD_LARGE},
        {"arc_zero_rad", offsetof(struct rig, arc.zero_rad), 1, FALSE, -G_PI, G_PI, TRUE},
        {"arc_tilt_rad", offsetof(struct rig, arc.tilt_rad), 2, FALSE, -1, 1, TRUE},
        {"arc_centre_mm", offsetof(struct rig, arc.centre_mm), 2, FALSE, -FIELD_LARGE, FIELD_LARGE,
         TRUE},
        {NULL},
    };
    static const char *const others[] = {"format", "id", NULL};

    return fields_read_name(r->file, r->path, "rig", "id", rig->id, sizeof rig->id, error) &&
           fields_read(r->file, r->path, "rig", counts, others, rig, error);
}

/* Refuses sections of devices beyond the counts: one of the two was edited. Other sections are
 * ignored. */
static gboolean check_groups(const struct reader *r, const struct rig *rig, GError **error) {
    const struct {
        const char *prefix;
        int n;
    } devices[] = {{"camera ", rig->n_cameras},
                   {"lamp ", rig->n_lamps},
                   {"laser ", rig->n_lasers},
                   {"mark ", rig->n_marks}};
    g_auto(GStrv) groups = g_key_file_get_groups(r->file, NULL);

    for (char **group = groups; *group; group++)
        for (gsize i = 0; i < G_N_ELEMENTS(devices); i++) {
            guint64 index;
            if (!g_str_has_prefix(*group, devices[i].prefix) ||
                !g_ascii_string_to_unsigned(*group + strlen(devices[i].prefix), 10, 0, G_MAXINT,
                                            &index, NULL) ||
                index < (guint64)devices[i].n)
                continue;
            g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                        "%s: there is a section [%s], but the counts in [rig] promise sections 0 "
                        "to %d only",
                        r->path, *group, devices[i].n - 1);
            return FALSE;
        }
    return TRUE;
}

static gboolean rig_text_read_rig(struct reader *r, struct rig *rig, GError **error) {
    if (!read_counts(r, rig, error) || !check_groups(r, rig, error))
        return FALSE;
    for (int i = 0; i < rig->n_cameras; i++)
        if (!rig_text_read_device(r, "camera", i, rig->cameras[i].name, camera_fields,
                                  &rig->cameras[i], error))
            return FALSE;
    for (int i = 0; i < rig->n_lamps; i++)
        if (!rig_text_read_device(r, "lamp", i, rig->lamps[i].name, lamp_fields, &rig->lamps[i],
                                  error))
            return FALSE;
    for (int i = 0; i < rig->n_lasers; i++)
        if (!rig_text_read_device(r, "laser", i, rig->lasers[i].name, laser_fields, &rig->lasers[i],
                                  error))
            return FALSE;
    for (int i = 0; i < rig->n_marks; i++)
        if (!rig_text_read_device(r, "mark", i, rig->marks[i].name, mark_fields, &rig->marks[i],
                                  error))
            return FALSE;
    return check_shapes(r, rig, error);
}

/* A truncated file lacks its last section; a file with another first one is not ours. */
static gboolean rig_text_check_frame(const struct reader *r, GError **error) {
    g_autofree char *format = g_key_file_get_string(r->file, "rig", "format", NULL);
    g_autofree char *end = g_key_file_get_string(r->file, "end", "complete", NULL);

    if (g_strcmp0(format, FORMAT) != 0)
        g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                    "%s: [rig] format: is '%s', not '" FORMAT
                    "': not a calibration of this version",
                    r->path, format ? format : "");
    else if (g_strcmp0(end, "yes") != 0)
        g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                    "%s: the file is cut short; restore it or calibrate again", r->path);
    else
        return TRUE;
    return FALSE;
}

/* Number (from 1) of the first line that is neither empty, a comment, a [group] nor key=value; 0:
 * none. The parser's own message quotes the line, but the path may be any file that only this
 * program may read. */
static int bad_line(const char *text) {
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
    g_autoptr(GError) cause = NULL;
    struct reader r = {.file = file, .path = path ? path : "calibration"};
    struct rig read = {0};

    if (!g_key_file_load_from_data(file, text, strlen(text), G_KEY_FILE_NONE, &cause)) {
        const int line = bad_line(text);
        g_autofree char *what =
            line > 0 ? g_strdup_printf("line %d is", line) : g_strdup("there is what is");
        g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                    "%s: not a calibration file: %s neither a [group] nor key=value", r.path, what);
        return FALSE;
    }
    if (!rig_text_check_frame(&r, error) || !rig_text_read_rig(&r, &read, error))
        return FALSE;
    *rig = read;
    return TRUE;
}
