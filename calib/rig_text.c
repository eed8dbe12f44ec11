#include "rig.h"

#include <errno.h>
#include <stddef.h>
#include <string.h>

#define FORMAT         "mesorig-calibration-1"
#define UNIT_TOLERANCE 1e-6

G_DEFINE_QUARK(rig_error, rig_error)

/* What is written of a struct: consecutive doubles or integers at an offset, under a name. */
struct field {
    const char *name;
    gsize offset;
    int n;
    gboolean integer;
    double min, max;
};

#define LARGE 1e9

static const struct field rig_fields[] = {
    {"arc_radius_mm", offsetof(struct rig, arc_radius_mm), 1, FALSE, 0, LARGE},
    {"arc_width_mm", offsetof(struct rig, arc_width_mm), 1, FALSE, 0, LARGE},
    {NULL},
};

#define CAMERA(member) offsetof(struct rig_camera, member)
static const struct field camera_fields[] = {
    {"width", CAMERA(width), 1, TRUE, 1, 65536},
    {"height", CAMERA(height), 1, TRUE, 1, 65536},
    {"fx_px", CAMERA(fx_px), 1, FALSE, 1e-3, LARGE},
    {"fy_px", CAMERA(fy_px), 1, FALSE, 1e-3, LARGE},
    {"cx_px", CAMERA(cx_px), 1, FALSE, -LARGE, LARGE},
    {"cy_px", CAMERA(cy_px), 1, FALSE, -LARGE, LARGE},
    {"k1", CAMERA(k1), 1, FALSE, -LARGE, LARGE},
    {"k2", CAMERA(k2), 1, FALSE, -LARGE, LARGE},
    {"k3", CAMERA(k3), 1, FALSE, -LARGE, LARGE},
    {"p1", CAMERA(p1), 1, FALSE, -LARGE, LARGE},
    {"p2", CAMERA(p2), 1, FALSE, -LARGE, LARGE},
    {"rotation", CAMERA(rotation), 9, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"translation_mm", CAMERA(translation_mm), 3, FALSE, -LARGE, LARGE},
    {"vignetting", CAMERA(vignetting), 1, FALSE, -1, 1},
    {"response", CAMERA(response), 1, FALSE, G_MINDOUBLE, G_MAXDOUBLE},
    {NULL},
};

#define LAMP(member) offsetof(struct rig_lamp, member)
static const struct field lamp_fields[] = {
    {"position_mm", LAMP(position_mm), 3, FALSE, -LARGE, LARGE},
    {"aim", LAMP(aim), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"exponent", LAMP(exponent), 1, FALSE, 0, 1e6},
    {"intensity", LAMP(intensity), 1, FALSE, G_MINDOUBLE, G_MAXDOUBLE},
    {NULL},
};

#define LASER(member) offsetof(struct rig_laser, member)
static const struct field laser_fields[] = {
    {"position_mm", LASER(position_mm), 3, FALSE, -LARGE, LARGE},
    {"axis", LASER(axis), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {"normal", LASER(normal), 3, FALSE, -1 - UNIT_TOLERANCE, 1 + UNIT_TOLERANCE},
    {NULL},
};

static void write_fields(GString *text, const struct field *fields, gconstpointer from) {
    char number[G_ASCII_DTOSTR_BUF_SIZE];

    for (const struct field *f = fields; f->name; f++) {
        const char *at = (const char *)from + f->offset;
        g_string_append_printf(text, "%s=", f->name);
        for (int i = 0; i < f->n; i++) {
            if (f->integer)
                g_snprintf(number, sizeof number, "%d", ((const int *)at)[i]);
            else
                g_ascii_dtostr(number, sizeof number, ((const double *)at)[i]);
            g_string_append_printf(text, "%s%s", i ? ";" : "", number);
        }
        g_string_append_c(text, '\n');
    }
}

/* A "key=value" line with the value escaped as GKeyFile reads it. */
static void write_string(GString *text, const char *key, const char *value) {
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_key_file_set_string(file, "x", key, value);
    g_autofree char *escaped = g_key_file_get_value(file, "x", key, NULL);
    g_string_append_printf(text, "%s=%s\n", key, escaped);
}

static void write_device(GString *text, const char *what, int index, const char *name,
                         const struct field *fields, gconstpointer from) {
    g_string_append_printf(text, "\n[%s %d]\n", what, index);
    write_string(text, "name", name);
    write_fields(text, fields, from);
}

char *rig_to_text(const struct rig *rig) {
    GString *text = g_string_new("[rig]\nformat=" FORMAT "\n");

    write_string(text, "id", rig->id);
    g_string_append_printf(text, "cameras=%d\nlamps=%d\nlasers=%d\n", rig->n_cameras, rig->n_lamps,
                           rig->n_lasers);
    write_fields(text, rig_fields, rig);
    for (int i = 0; i < rig->n_cameras; i++)
        write_device(text, "camera", i, rig->cameras[i].name, camera_fields, &rig->cameras[i]);
    for (int i = 0; i < rig->n_lamps; i++)
        write_device(text, "lamp", i, rig->lamps[i].name, lamp_fields, &rig->lamps[i]);
    for (int i = 0; i < rig->n_lasers; i++)
        write_device(text, "laser", i, rig->lasers[i].name, laser_fields, &rig->lasers[i]);
    g_string_append(text, "\n[end]\ncomplete=yes\n");
    return g_string_free(text, FALSE);
}

struct reader {
    GKeyFile *file;
    const char *path;
    int groups_read;
};

static gboolean refuse(const struct reader *r, const char *group, const char *key, GError **error,
                       const char *why) {
    g_set_error(error, RIG_ERROR, RIG_ERROR_VALUE, "%s: [%s] %s: %s", r->path, group, key, why);
    return FALSE;
}

static gboolean parse_number(const char *text, double *ret) {
    char *end;

    *ret = g_ascii_strtod(text, &end);
    return end != text && *end == '\0' && isfinite(*ret);
}

static gboolean read_field(const struct reader *r, const char *group, const struct field *f,
                           gpointer to, GError **error) {
    g_autofree char *value = g_key_file_get_string(r->file, group, f->name, NULL);
    if (!value)
        return refuse(r, group, f->name, error, "missing; calibrate again or restore the file");
    g_auto(GStrv) words = g_strsplit(value, ";", f->n + 1);
    if ((int)g_strv_length(words) != f->n)
        return refuse(r, group, f->name, error, "has not as many numbers as it should have");
    for (int i = 0; i < f->n; i++) {
        double number;
        if (!parse_number(words[i], &number))
            return refuse(r, group, f->name, error, "is not a finite number");
        if (number < f->min || number > f->max)
            return refuse(r, group, f->name, error, "is out of range");
        if (f->integer && number != floor(number))
            return refuse(r, group, f->name, error, "is not a whole number");
        if (f->integer)
            ((int *)((char *)to + f->offset))[i] = (int)number;
        else
            ((double *)((char *)to + f->offset))[i] = number;
    }
    return TRUE;
}

static gboolean known_keys(const struct reader *r, const char *group, const struct field *fields,
                           const char *const *others, GError **error) {
    g_auto(GStrv) keys = g_key_file_get_keys(r->file, group, NULL, NULL);

    for (char **key = keys; key && *key; key++) {
        const struct field *f = fields;
        while (f->name && !g_str_equal(f->name, *key))
            f++;
        if (!f->name && !g_strv_contains(others, *key))
            return refuse(r, group, *key, error,
                          "is not known; a newer version may have written it");
    }
    return TRUE;
}

static gboolean read_fields(const struct reader *r, const char *group, const struct field *fields,
                            gpointer to, GError **error) {
    for (const struct field *f = fields; f->name; f++)
        if (!read_field(r, group, f, to, error))
            return FALSE;
    return TRUE;
}

static gboolean read_name(const struct reader *r, const char *group, const char *key, char *to,
                          gsize size, GError **error) {
    g_autofree char *value = g_key_file_get_string(r->file, group, key, NULL);

    if (!value || !*value)
        return refuse(r, group, key, error, "missing");
    if (strlen(value) >= size)
        return refuse(r, group, key, error, "is too long");
    g_strlcpy(to, value, size);
    return TRUE;
}

static gboolean read_device(struct reader *r, const char *what, int index, char *name,
                            const struct field *fields, gpointer to, GError **error) {
    static const char *const others[] = {"name", NULL};
    g_autofree char *group = g_strdup_printf("%s %d", what, index);

    r->groups_read++;
    return read_name(r, group, "name", name, RIG_NAME, error) &&
           known_keys(r, group, fields, others, error) && read_fields(r, group, fields, to, error);
}

static gboolean is_unit(struct vec3 v) {
    return fabs(vec3_length(v) - 1) < UNIT_TOLERANCE;
}

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
            return refuse(r, rig->cameras[i].name, "rotation", error, "is not a rotation");
    for (int i = 0; i < rig->n_lamps; i++)
        if (!is_unit(rig->lamps[i].aim))
            return refuse(r, rig->lamps[i].name, "aim", error, "is not a unit vector");
    for (int i = 0; i < rig->n_lasers; i++) {
        const struct rig_laser *laser = &rig->lasers[i];
        if (!is_unit(laser->axis) || !is_unit(laser->normal) ||
            fabs(vec3_dot(laser->axis, laser->normal)) > UNIT_TOLERANCE)
            return refuse(r, laser->name, "axis and normal", error,
                          "are not perpendicular unit vectors");
    }
    return TRUE;
}

static gboolean read_counts(const struct reader *r, struct rig *rig, GError **error) {
    const struct field counts[] = {
        {"cameras", offsetof(struct rig, n_cameras), 1, TRUE, 0, RIG_MAX_CAMERAS},
        {"lamps", offsetof(struct rig, n_lamps), 1, TRUE, 0, RIG_MAX_LAMPS},
        {"lasers", offsetof(struct rig, n_lasers), 1, TRUE, 0, RIG_MAX_LASERS},
        {NULL},
    };
    static const char *const others[] = {"format", "id", "cameras", "lamps", "lasers", NULL};

    return known_keys(r, "rig", rig_fields, others, error) &&
           read_name(r, "rig", "id", rig->id, sizeof rig->id, error) &&
           read_fields(r, "rig", counts, rig, error);
}

static gboolean read_rig(struct reader *r, struct rig *rig, GError **error) {
    if (!read_counts(r, rig, error) || !read_fields(r, "rig", rig_fields, rig, error))
        return FALSE;
    for (int i = 0; i < rig->n_cameras; i++)
        if (!read_device(r, "camera", i, rig->cameras[i].name, camera_fields, &rig->cameras[i],
                         error))
            return FALSE;
    for (int i = 0; i < rig->n_lamps; i++)
        if (!read_device(r, "lamp", i, rig->lamps[i].name, lamp_fields, &rig->lamps[i], error))
            return FALSE;
    for (int i = 0; i < rig->n_lasers; i++)
        if (!read_device(r, "laser", i, rig->lasers[i].name, laser_fields, &rig->lasers[i], error))
            return FALSE;
    return check_shapes(r, rig, error);
}

/* A file cut short has lost its last section; a wrong first one is not ours at all. */
static gboolean check_frame(const struct reader *r, GError **error) {
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

gboolean rig_from_text(struct rig *rig, const char *text, const char *path, GError **error) {
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autoptr(GError) cause = NULL;
    struct reader r = {.file = file, .path = path ? path : "calibration"};
    struct rig read = {0};

    if (!g_key_file_load_from_data(file, text, strlen(text), G_KEY_FILE_NONE, &cause)) {
        g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT, "%s: not a calibration file: %s", r.path,
                    cause->message);
        return FALSE;
    }
    if (!check_frame(&r, error) || !read_rig(&r, &read, error))
        return FALSE;
    gsize n_groups;
    g_auto(GStrv) groups = g_key_file_get_groups(file, &n_groups);
    if (n_groups != (gsize)r.groups_read + 2) {
        g_set_error(error, RIG_ERROR, RIG_ERROR_FORMAT,
                    "%s: has %d sections where its counts promise %d", r.path, (int)n_groups,
                    r.groups_read + 2);
        return FALSE;
    }
    *rig = read;
    return TRUE;
}
