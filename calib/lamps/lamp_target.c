#include "lamps.h"

#include "base/input_file.h"

#include <math.h>
#include <string.h>

#define MAX_BYTES (1 << 20)

/* Default standard deviations of sizes: posts are cut and set by hand, balls are made for
 * bearings. */
#define POST_MM 0.02
#define BALL_MM 0.005

struct reader {
    GKeyFile *file;
    const char *path;
};

static gboolean refuse(const struct reader *r, GError **error, const char *key, const char *why) {
    g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_TARGET, "%s: [target] %s: %s", r->path, key, why);
    return FALSE;
}

static gboolean read_list(const struct reader *r, const char *key, double min, double *ret,
                          gsize most, gsize *ret_n, GError **error) {
    g_autoptr(GError) cause = NULL;
    g_autofree double *list = g_key_file_get_double_list(r->file, "target", key, ret_n, &cause);
    if (!list || *ret_n == 0)
        return refuse(r, error, key, cause ? cause->message : "is empty");
    if (*ret_n > most)
        return refuse(r, error, key, "has too many numbers");
    for (gsize i = 0; i < *ret_n; i++) {
        if (!(list[i] >= min) || !(list[i] <= 1000)) {
            g_autofree char *why =
                g_strdup_printf("%g is out of range: %g to 1000 mm", list[i], min);
            return refuse(r, error, key, why);
        }
        ret[i] = list[i];
    }
    return TRUE;
}

static gboolean read_marks(const struct reader *r, struct lamp_target *target, GError **error) {
    double numbers[3 * LAMP_MAX_MARKS];
    gsize n;
    if (!read_list(r, "places_mm", -1000, numbers, G_N_ELEMENTS(numbers), &n, error))
        return FALSE;
    if (n % 3 != 0)
        return refuse(r, error, "places_mm",
                      "must be x;y;height of each post, or x;y;radius of each ball");
    target->n = (int)n / 3;
    for (int i = 0; i < target->n; i++) {
        target->marks[i] =
            (struct lamp_mark){numbers[3 * i], numbers[3 * i + 1], numbers[3 * i + 2]};
        if (!(target->marks[i].size_mm > 0.1)) {
            g_autofree char *why = g_strdup_printf(
                "the height or radius of number %d is %g mm, and must be above 0.1; give "
                "millimetres",
                i + 1, target->marks[i].size_mm);
            return refuse(r, error, "places_mm", why);
        }
        for (int j = 0; j < i; j++)
            if (hypot(target->marks[i].x_mm - target->marks[j].x_mm,
                      target->marks[i].y_mm - target->marks[j].y_mm) < 0.1)
                return refuse(r, error, "places_mm", "two posts or balls have the same position");
    }
    return TRUE;
}

gboolean lamp_target_load(struct lamp_target *target, const char *path, GError **error) {
    static const char *const known[] = {"kind",      "plane_mm",     "plate_mm", "radius_mm",
                                        "places_mm", "tolerance_mm", NULL};
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autoptr(GError) cause = NULL;
    const struct reader r = {file, path};
    gsize n;
    memset(target, 0, sizeof *target);
    g_autofree char *text = input_file_read_text(path, MAX_BYTES, &cause);
    if (!text) {
        input_file_propagate(g_steal_pointer(&cause), LAMPS_ERROR, LAMPS_ERROR_TARGET,
                             LAMPS_ERROR_TARGET, error);
        return FALSE;
    }
    if (!g_key_file_load_from_data(file, text, (gsize)-1, G_KEY_FILE_NONE, &cause)) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_TARGET, "%s: not a target's description: %s",
                    path, cause->message);
        return FALSE;
    }
    g_auto(GStrv) keys = g_key_file_get_keys(file, "target", NULL, NULL);
    for (char **key = keys; key && *key; key++)
        if (!g_strv_contains(known, *key))
            return refuse(&r, error, *key, "is not a known key");
    g_autofree char *kind = g_key_file_get_string(file, "target", "kind", NULL);
    if (g_strcmp0(kind, "poles") != 0 && g_strcmp0(kind, "balls") != 0)
        return refuse(&r, error, "kind", "must be poles or balls");
    target->kind = g_str_equal(kind, "balls") ? LAMP_BALLS : LAMP_POLES;
    target->tolerance_mm = target->kind == LAMP_BALLS ? BALL_MM : POST_MM;
    if (g_key_file_has_key(file, "target", "tolerance_mm", NULL) &&
        !read_list(&r, "tolerance_mm", 0, &target->tolerance_mm, 1, &n, error))
        return FALSE;
    if (!read_list(&r, "plane_mm", 0, &target->plane_mm, 1, &n, error) ||
        !read_marks(&r, target, error))
        return FALSE;
    if (target->plane_mm > 0 && target->plane_mm < 0.05) {
        g_autofree char *why =
            g_strdup_printf("%g mm is no height of a plate; give millimetres, or 0 if the posts or "
                            "balls stand on the turntable itself",
                            target->plane_mm);
        return refuse(&r, error, "plane_mm", why);
    }
    if (target->kind == LAMP_BALLS)
        return TRUE;
    return read_list(&r, "plate_mm", 1, target->plate_mm, 2, &n, error) &&
           (n == 2 || refuse(&r, error, "plate_mm", "must be width;height")) &&
           read_list(&r, "radius_mm", 0.05, &target->radius_mm, 1, &n, error);
}
