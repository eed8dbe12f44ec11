/* This file writes and reads the text of a calibration file. Tables of fields map structs to
 * sections and keys. The names of sections and keys are the file format and must not change. */
#include "calibration.h"
#include "geometry/fields.h"

#include <stddef.h>
#include <string.h>

static const char end[] = "\n[end]\ncomplete=yes\n";

#define PART(member) offsetof(struct calibration_part, member)
/* Each row of the tables (struct field of fields.h) has a key, the offset of the member, the number
 * of values, whether they are integers, the smallest and the largest valid value, and the flags
 * optional and sparing. */
static const struct field part_fields[] = {
    {"residual_rms", PART(residual_rms), 1, FALSE, 0, FIELD_LARGE},
    {"residual_expected", PART(residual_expected), 1, FALSE, 0, FIELD_LARGE, TRUE, TRUE},
    {"degrees_of_freedom", PART(degrees_of_freedom), 1, TRUE, 0, G_MAXINT},
    {"pictures", PART(pictures), 1, TRUE, 0, G_MAXINT},
    {NULL},
};

static const struct {
    const char *key;
    gsize offset;
} part_strings[] = {
    {"date", PART(date)},
    {"method", PART(method)},
    {"residual_unit", PART(residual_unit)},
    {"checksum", PART(checksum)},
};

#define CAMERA(member) offsetof(struct calibration_camera, member)
static const struct field camera_fields[] = {
    {"covariance", CAMERA(covariance), CALIBRATION_CAMERA_PARAMETERS *CALIBRATION_CAMERA_PARAMETERS,
     FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"further_covariance", CAMERA(further_covariance), 3 * CALIBRATION_ALL_CAMERA_PARAMETERS, FALSE,
     -FIELD_LARGE, FIELD_LARGE, TRUE, TRUE},
    {"lateral_colour", CAMERA(lateral_colour), 3, FALSE, 0, 1, TRUE, TRUE},
    {"residual_rms_px", CAMERA(residual_rms_px), 1, FALSE, 0, FIELD_LARGE},
    {"expected_px", CAMERA(expected_px), 1, FALSE, 0, FIELD_LARGE, TRUE, TRUE},
    {"points", CAMERA(points), 1, TRUE, 0, G_MAXINT},
    {NULL},
};

#define LAMP(member) offsetof(struct calibration_lamp, member)
static const struct field lamp_fields[] = {
    {"position_covariance_mm2", LAMP(position_covariance_mm2), 9, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {NULL},
};

#define LASER(member) offsetof(struct calibration_laser, member)
static const struct field laser_fields[] = {
    {"position_mm", LASER(position_mm), 3, FALSE, 0, FIELD_LARGE},
    {"axis_rad", LASER(axis_rad), 1, FALSE, 0, FIELD_LARGE},
    {"normal_rad", LASER(normal_rad), 1, FALSE, 0, FIELD_LARGE},
    {"stretch", LASER(stretch), 1, FALSE, 0, FIELD_LARGE, TRUE},
    {"residual_rms_mm", LASER(residual_rms_mm), 1, FALSE, 0, FIELD_LARGE, TRUE},
    {"expected_rms_mm", LASER(expected_rms_mm), 1, FALSE, 0, FIELD_LARGE, TRUE, TRUE},
    {"bend_rad", LASER(bend_rad), 1, FALSE, 0, FIELD_LARGE, TRUE, TRUE},
    {"from_prior", LASER(from_prior), CALIBRATION_LASER_VALUES, TRUE, 0, 1, TRUE, TRUE},
    {"sheet_covariance", LASER(sheet.covariance), RIG_SHEET_PARAMETERS *RIG_SHEET_PARAMETERS, FALSE,
     -FIELD_LARGE, FIELD_LARGE, TRUE, TRUE},
    {"line_rad", LASER(line_rad), 1, FALSE, 0, 1, TRUE, TRUE},
    {NULL},
};

#define TURNTABLE(member) offsetof(struct calibration_turntable, member)
static const struct field turntable_fields[] = {
    {"wobble_rad", TURNTABLE(wobble_rad), 1, FALSE, 0, 1},
    {NULL},
};

#define ARC(member) offsetof(struct calibration_arc, member)
static const struct field arc_fields[] = {
    {"zero_rad", ARC(zero_rad), 1, FALSE, 0, FIELD_LARGE},
    {"tilt_rad", ARC(tilt_rad), 2, FALSE, 0, FIELD_LARGE},
    {"centre_mm", ARC(centre_mm), 2, FALSE, 0, FIELD_LARGE},
    {NULL},
};

#define RADIOMETRY(member) offsetof(struct radiometry_camera, member)
static const struct field radiometry_fields[] = {
    {"colour", RADIOMETRY(colour), 3, FALSE, 1e-3, 1e3},
    {"flat", RADIOMETRY(flat), RADIOMETRY_SMOOTH, FALSE, -3, 3},
    {"steps", RADIOMETRY(flat[RADIOMETRY_SMOOTH]), RADIOMETRY_FLAT - RADIOMETRY_SMOOTH, FALSE, -3,
     3, TRUE, TRUE},
    {"response_error", RADIOMETRY(response_error), 1, FALSE, 0, 10},
    {"colour_error", RADIOMETRY(colour_error), 3, FALSE, 0, 1e3},
    {"flat_error", RADIOMETRY(flat_error), RADIOMETRY_SMOOTH, FALSE, 0, 10},
    {"steps_error", RADIOMETRY(flat_error[RADIOMETRY_SMOOTH]), RADIOMETRY_FLAT - RADIOMETRY_SMOOTH,
     FALSE, 0, 10, TRUE, TRUE},
    {"glare", RADIOMETRY(glare), 2, FALSE, 0, 1, TRUE, TRUE},
    {"excess", RADIOMETRY(excess), 1, FALSE, 0, 10, TRUE, TRUE},
    {"cells", RADIOMETRY(cells), 1, TRUE, 0, G_MAXINT},
    {NULL},
};

#define LIGHT(member) offsetof(struct radiometry_lamp, member)
static const struct field light_fields[] = {
    {"colour", LIGHT(colour), 3, FALSE, 1e-3, 1e3},
    {"intensity_error", LIGHT(intensity_error), 1, FALSE, 0, 10},
    {"exponent_error", LIGHT(exponent_error), 1, FALSE, 0, 1e6},
    {"aim_error_rad", LIGHT(aim_error_rad), 1, FALSE, 0, 10},
    {"colour_error", LIGHT(colour_error), 3, FALSE, 0, 1e3},
    {"flicker", LIGHT(flicker), 2, FALSE, 0, 10, TRUE, TRUE},
    {"shots", LIGHT(shots), 1, TRUE, 0, G_MAXINT},
    {NULL},
};

#define NOISE(member) offsetof(struct calibration_noise, transfer.member)
static const struct field noise_fields[] = {
    {"black_dn", NOISE(black_dn), 2, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"dark_dn_s", NOISE(dark_dn_s), 2, FALSE, -FIELD_LARGE, FIELD_LARGE},
    {"gain_dn_e", NOISE(gain_dn_e), 2, FALSE, 0, FIELD_LARGE},
    {"read_noise_e", NOISE(read_noise_e), 2, FALSE, 0, FIELD_LARGE},
    {"curvature", NOISE(curvature), 2, FALSE, -10, 10},
    {"linearity", NOISE(linearity), 1, FALSE, 0, 10},
    {"quality", NOISE(quality), 1, FALSE, 0, FIELD_LARGE},
    {"points", NOISE(n_points), 1, TRUE, 0, G_MAXINT},
    {NULL},
};

#define FIDUCIAL(member) offsetof(struct calibration_fiducial, member)
static const struct field fiducial_fields[] = {
    {"centre_mm", FIDUCIAL(centre_mm), 3, FALSE, 0, FIELD_LARGE},
    {"reflectance", FIDUCIAL(reflectance), 3, FALSE, 0, 10},
    {NULL},
};

#define COLOUR(member) offsetof(struct colour_matrix, member)
static const struct field colour_fields[] = {
    {"matrix", COLOUR(matrix), 9, FALSE, -100, 100},
    {"error", COLOUR(error), 9, FALSE, 0, 100},
    {"residual", COLOUR(residual), 1, FALSE, 0, 1000},
    {"patches", COLOUR(patches), 1, TRUE, 0, G_MAXINT},
    {NULL},
};

/* A group describes an array of struct calibration. Each element whose first member `known` is set
 * has a section "[PREFIX i]". `count` is the offset, in struct rig, of the number of elements. If
 * count is NONE, the group is a single struct with the section "[PREFIX]". */
#define NONE G_MAXSIZE
static const struct group {
    const char *prefix;
    gsize count, offset, size;
    const struct field *fields;
} groups[] = {
#define N(member)     offsetof(struct rig, n_##member)
#define ARRAY(member) offsetof(struct calibration, member), sizeof(*((Calibration *)0)->member)
#define ONE(member)   offsetof(struct calibration, member), sizeof(((Calibration *)0)->member)
    {"camera errors", N(cameras), ARRAY(cameras), camera_fields},
    {"turntable errors", NONE, ONE(turntable), turntable_fields},
    {"arc errors", NONE, ONE(arc), arc_fields},
    {"lamp errors", N(lamps), ARRAY(lamps), lamp_fields},
    {"laser errors", N(lasers), ARRAY(lasers), laser_fields},
    {"camera radiometry", N(cameras), ARRAY(camera_radiometry), radiometry_fields},
    {"lamp radiometry", N(lamps), ARRAY(lamp_radiometry), light_fields},
    {"camera noise", N(cameras), ARRAY(noise), noise_fields},
    {"mark errors", N(fiducials), ARRAY(fiducials), fiducial_fields},
    {"colour", NONE, ONE(colour), colour_fields},
};

/* Returns the number of elements of a group, from the counts of the rig. */
static int calibration_text_count_of(const struct group *group, const struct rig *rig) {
    return group->count == NONE ? 1 : *(const int *)((const char *)rig + group->count);
}

/* Returns the name of the i-th section of a group. */
static char *calibration_text_name_of(const struct group *group, int i) {
    return group->count == NONE ? g_strdup(group->prefix)
                                : g_strdup_printf("%s %d", group->prefix, i);
}

/* The parts and groups go between the rig's sections and its end mark. */
char *calibration_to_text(const struct calibration *calibration) {
    g_autofree char *rig = rig_to_text(&calibration->rig);
    GString *text = g_string_new(rig);

    g_assert(g_str_has_suffix(rig, end));
    g_string_truncate(text, text->len - strlen(end));
    for (int k = 0; k < CALIBRATION_PARTS; k++) {
        const struct calibration_part *part = &calibration->parts[k];
        if (!part->done)
            continue;
        g_string_append_printf(text, "\n[part %s]\n",
                               calibration_part_name((enum calibration_kind)k));
        for (gsize i = 0; i < G_N_ELEMENTS(part_strings); i++) {
            const char *value = *(char *const *)((const char *)part + part_strings[i].offset);
            fields_write_string(text, part_strings[i].key, value ? value : "");
        }
        fields_write(text, part_fields, part);
        for (guint i = 0; i < part->rejected->len; i++) {
            g_autofree char *key = g_strdup_printf("rejected_%u", i);
            fields_write_string(text, key, part->rejected->pdata[i]);
        }
    }
    for (gsize k = 0; k < G_N_ELEMENTS(groups); k++) {
        const int n = calibration_text_count_of(&groups[k], &calibration->rig);
        for (int i = 0; i < n; i++) {
            const char *at =
                (const char *)calibration + groups[k].offset + (gsize)i * groups[k].size;
            if (!*(const gboolean *)at) /* `known` is not set */
                continue;
            g_autofree char *name = calibration_text_name_of(&groups[k], i);
            g_string_append_printf(text, "\n[%s]\n", name);
            fields_write(text, groups[k].fields, at);
        }
    }
    g_autofree char *extra = g_key_file_to_data(calibration->extra, NULL, NULL);
    if (*extra)
        g_string_append_printf(text, "\n%s", extra);
    g_string_append(text, end);
    return g_string_free(text, FALSE);
}

struct reader {
    GKeyFile *file;
    const char *path;
    GHashTable *taken; /* names of the sections read */
};

/* Returns whether a section exists. A section that exists counts as read from now on. */
static gboolean calibration_text_has(struct reader *r, const char *group) {
    if (!g_key_file_has_group(r->file, group))
        return FALSE;
    g_hash_table_add(r->taken, g_strdup(group));
    return TRUE;
}

/* Reads a part. If the part has no section, it was not calibrated, and TRUE is returned. The keys
 * of a section are strings, numbers, and rejected_0, rejected_1 … without gaps. */
static gboolean calibration_text_read_part(struct reader *r, struct calibration_part *part,
                                           const char *name, GError **error) {
    g_autofree char *group = g_strdup_printf("part %s", name);
    g_autoptr(GPtrArray) others = g_ptr_array_new_with_free_func(g_free);

    if (!calibration_text_has(r, group))
        return TRUE;
    for (gsize i = 0; i < G_N_ELEMENTS(part_strings); i++) {
        char **to = (char **)((char *)part + part_strings[i].offset);
        *to = g_key_file_get_string(r->file, group, part_strings[i].key, NULL);
        if (!*to)
            return fields_refuse(r->path, group, part_strings[i].key, error,
                                 "is missing; calibrate again or restore the file");
        g_ptr_array_add(others, g_strdup(part_strings[i].key));
    }
    for (int i = 0;; i++) {
        g_autofree char *key = g_strdup_printf("rejected_%d", i);
        char *value = g_key_file_get_string(r->file, group, key, NULL);
        if (!value)
            break;
        g_ptr_array_add(part->rejected, value);
        g_ptr_array_add(others, g_steal_pointer(&key));
    }
    g_ptr_array_add(others, NULL);
    g_autoptr(GDateTime) date = g_date_time_new_from_iso8601(part->date, NULL);
    if (!date)
        return fields_refuse(
            r->path, group, "date", error,
            "is not a date such as 2026-01-31T12:00:00Z; calibrate again or restore the file");
    part->done = TRUE;
    return fields_read(r->file, r->path, group, part_fields, (const char *const *)others->pdata,
                       part, error);
}

/* Returns whether a matrix is symmetric, with a non-negative diagonal and |c_ij| ≤ √(c_ii c_jj). */
static gboolean is_covariance(const double *c, int n) {
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            const double bound = sqrt(c[i * n + i] * c[j * n + j]) * (1 + 1e-6);
            if (!(c[i * n + i] >= 0) || fabs(c[i * n + j]) > bound ||
                fabs(c[i * n + j] - c[j * n + i]) > 1e-9 * bound)
                return FALSE;
        }
    return TRUE;
}

/* Returns whether the covariance of all parameters of a camera, including k4, k5 and k6, is
 * valid. */
static gboolean calibration_text_is_camera(const struct calibration_camera *camera) {
    enum { KNOWN = CALIBRATION_CAMERA_PARAMETERS, ALL = CALIBRATION_ALL_CAMERA_PARAMETERS };
    double c[ALL][ALL];
    for (int i = 0; i < ALL; i++)
        for (int k = 0; k < ALL; k++)
            c[i][k] = i >= KNOWN   ? camera->further_covariance[i - KNOWN][k]
                      : k >= KNOWN ? camera->further_covariance[k - KNOWN][i]
                                   : camera->covariance[i][k];
    return is_covariance(&c[0][0], ALL);
}

/* Returns whether a list has only finite numbers, separated by semicolons. A separator may also
 * follow the last number. */
static gboolean are_finite(const char *list) {
    g_auto(GStrv) words = g_strsplit(list, ";", -1);

    for (char **word = words; *word; word++) {
        char *rest;
        const double number = g_ascii_strtod(*word, &rest);
        if (!**word && !word[1])
            break; /* lists of a GKeyFile end with a separator */
        if (rest == *word || *rest || !isfinite(number))
            return FALSE;
    }
    return TRUE;
}

/* Copies all sections that are neither the rig's nor in r->taken into to->extra. Some of these
 * sections hold lists of numbers for reports (residuals, steps of a sweep, errors of the turntable,
 * drift of lamps). Returns FALSE with an error if such a list has a number that is not finite. */
static gboolean calibration_text_keep_extra(const struct reader *r, struct calibration *to,
                                            GError **error) {
    static const char *const lists[] = {"laser steps", "turntable", "lamp drift", NULL};
    g_auto(GStrv) names = g_key_file_get_groups(r->file, NULL);
    g_autofree char *text = rig_to_text(&to->rig);
    g_autoptr(GKeyFile) rig = g_key_file_new();

    g_key_file_load_from_data(rig, text, (gsize)-1, G_KEY_FILE_NONE, NULL);
    for (char **name = names; *name; name++) {
        if (g_key_file_has_group(rig, *name) || g_hash_table_contains(r->taken, *name))
            continue;
        const gboolean numbers =
            g_strv_contains(lists, *name) || g_str_has_prefix(*name, "camera residuals ");
        g_auto(GStrv) keys = g_key_file_get_keys(r->file, *name, NULL, NULL);
        for (char **key = keys; key && *key; key++) {
            g_autofree char *value = g_key_file_get_value(r->file, *name, *key, NULL);
            if (numbers && !are_finite(value))
                return fields_refuse(r->path, *name, *key, error,
                                     "is not a list of finite numbers; calibrate again or restore "
                                     "the file");
            g_key_file_set_value(to->extra, *name, *key, value);
        }
    }
    return TRUE;
}

/* Sets an error that says that the key of section "[prefix i]" is not a covariance. Returns
 * FALSE. */
static gboolean refuse_covariance(const struct reader *r, const char *prefix, int i,
                                  const char *key, GError **error) {
    g_autofree char *group = g_strdup_printf("%s %d", prefix, i);
    return fields_refuse(r->path, group, key, error,
                         "is not a covariance: it must be symmetric, with |c_ij| ≤ √(c_ii c_jj); "
                         "calibrate again or restore the file");
}

/* Reads parts, groups, and then all other sections. Then checks the covariances of cameras, lasers
 * and lamps. */
static gboolean calibration_text_read_all(struct reader *r, struct calibration *to,
                                          GError **error) {
    static const char *const none[] = {NULL};

    for (int i = 0; i < CALIBRATION_PARTS; i++)
        if (!calibration_text_read_part(r, &to->parts[i],
                                        calibration_part_name((enum calibration_kind)i), error))
            return FALSE;
    for (gsize k = 0; k < G_N_ELEMENTS(groups); k++) {
        const int n = calibration_text_count_of(&groups[k], &to->rig);
        for (int i = 0; i < n; i++) {
            char *at = (char *)to + groups[k].offset + (gsize)i * groups[k].size;
            g_autofree char *name = calibration_text_name_of(&groups[k], i);
            if (!calibration_text_has(r, name))
                continue;
            if (!fields_read(r->file, r->path, name, groups[k].fields, none, at, error))
                return FALSE;
            *(gboolean *)at = TRUE; /* sets `known` */
        }
    }
    if (!calibration_text_keep_extra(r, to, error))
        return FALSE;
    for (int i = 0; i < to->rig.n_cameras; i++)
        if (!calibration_text_is_camera(&to->cameras[i]))
            return refuse_covariance(r, "camera errors", i, "covariance", error);
    for (int i = 0; i < to->rig.n_lasers; i++)
        if (!is_covariance(&to->lasers[i].sheet.covariance[0][0], RIG_SHEET_PARAMETERS))
            return refuse_covariance(r, "laser errors", i, "sheet_covariance", error);
    for (int i = 0; i < to->rig.n_lamps; i++)
        if (!is_covariance(&to->lamps[i].position_covariance_mm2[0][0], 3))
            return refuse_covariance(r, "lamp errors", i, "position_covariance_mm2", error);
    return TRUE;
}

/* rig_from_text() checks format, version and end mark first. */
struct calibration *calibration_from_text(const char *text, const char *path, GError **error) {
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autoptr(GHashTable) taken = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    struct reader r = {file, path ? path : "calibration", taken};
    struct rig rig;

    if (!rig_from_text(&rig, text, r.path, error) ||
        !g_key_file_load_from_data(file, text, strlen(text), G_KEY_FILE_NONE, error))
        return NULL;
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    return calibration_text_read_all(&r, calibration, error) ? g_steal_pointer(&calibration) : NULL;
}
