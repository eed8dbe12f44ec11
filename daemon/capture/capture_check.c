#include "capture_check.h"

#include "base/config.h"

#include <errno.h>
#include <string.h>
#include <sys/statvfs.h>

#include "capture_calibration.h"
#include "exr/exr.h"

/* Disk space that must be free in addition to the predicted size. It is for the database's journal
 * and for products that are being made. */
#define SPARE_BYTES (G_GUINT64_CONSTANT(64) << 20)
#define FULL_BELOW  (G_GUINT64_CONSTANT(1) << 20)

static gboolean stat_nearest(const char *path, struct statvfs *ret) {
    g_autofree char *at = g_canonicalize_filename(path, NULL);
    while (statvfs(at, ret) < 0) {
        if (errno != ENOENT || !strcmp(at, "/"))
            return FALSE;
        char *parent = g_path_get_dirname(at);
        g_free(at);
        at = parent;
    }
    return TRUE;
}

guint64 capture_free_bytes(const char *path) {
    struct statvfs stat;
    return stat_nearest(path, &stat) ? (guint64)stat.f_bavail * stat.f_frsize : G_MAXUINT64;
}

gboolean capture_is_full(const char *directory, const GError *error) {
    return g_error_matches(error, SESSION_ERROR, SESSION_ERROR_FULL) ||
           g_error_matches(error, EXR_ERROR, EXR_ERROR_FULL) ||
           capture_free_bytes(directory) < FULL_BELOW;
}

gboolean capture_check_disk(const char *path, guint64 bytes, GError **error) {
    struct statvfs stat;
    if (stat_nearest(path, &stat) && stat.f_blocks == 0) {
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_IO,
                    "%s: no session can be written there, because it is not on a disk; choose a "
                    "folder on a disk",
                    path);
        return FALSE;
    }
    const guint64 free_bytes = capture_free_bytes(path);
    if (free_bytes >= bytes + SPARE_BYTES)
        return TRUE;
    g_autofree char *needed_text = g_format_size(bytes);
    g_autofree char *spare_text = g_format_size(SPARE_BYTES);
    g_autofree char *free_text = g_format_size(free_bytes);
    g_set_error(error, SESSION_ERROR, SESSION_ERROR_FULL,
                "%s: the session needs %s for frames, and %s for its database and the first "
                "products, but only %s are free there; free some space or choose another disk",
                path, needed_text, spare_text, free_text);
    return FALSE;
}

gboolean capture_check_rig(Session *session, const GPtrArray *shots, const struct devices *devices,
                           GError **error) {
    const struct rig *rig = &devices->geometry;
    const char *path = session_path(session);
    g_autofree char *text = session_text(session, "calibration.conf", error);
    struct rig then;
    if (!text || !rig_from_text(&then, text, path, error))
        return FALSE;
    if (strcmp(then.id, rig->id)) {
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                    "%s: the session was begun on rig %s, but this is rig %s; give the rig file "
                    "with which it was begun",
                    path, then.id, rig->id);
        return FALSE;
    }
    for (int c = 0; c < MIN(then.n_cameras, rig->n_cameras); c++) {
        const struct rig_camera *a = &then.cameras[c], *b = &rig->cameras[c];
        if (!strcmp(a->name, b->name) && a->width == b->width && a->height == b->height)
            continue;
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                    "%s: camera %d, counted from 1, was %s with %d × %d pixels when the session "
                    "was begun and is %s "
                    "with %d × %d now; use the rig file of the session",
                    path, c + 1, a->name, a->width, a->height, b->name, b->width, b->height);
        return FALSE;
    }
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        int n = shot->kind == SHOT_SWEEP ? rig->n_lasers : rig->n_lamps;
        gboolean device = shot->kind == SHOT_DARK || (shot->device >= 0 && shot->device < n);
        if (device && !camera_set_is_empty(shot->cameras) &&
            camera_set_next(shot->cameras, rig->n_cameras - 1) < 0)
            continue;
        const char *missing = device ? "a camera" : shot->kind == SHOT_SWEEP ? "a laser" : "a lamp";
        g_set_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT,
                    "%s: shot %" G_GINT64_FORMAT
                    " needs %s that rig %s does not have; use the rig file of the session",
                    path, shot->id, missing, rig->id);
        return FALSE;
    }
    return TRUE;
}

#define SHOWN_CHANGES 8

/* Compares a section of the rig file `then` with the same section `now`. Adds a text to ret for
 * each key whose value differs, and then for each key that is new in `now`. */
static void compare_section(const struct config_section *then, const struct config_section *now,
                            GPtrArray *ret) {
    for (const char *const *key = config_keys(then); *key; key++) {
        const char *was = config_value(then, *key, NULL), *is = config_value(now, *key, NULL);
        if (!is)
            g_ptr_array_add(ret, g_strdup_printf("[%s] %s was %s and is not given now", then->group,
                                                 *key, was));
        else if (strcmp(was, is) != 0)
            g_ptr_array_add(
                ret, g_strdup_printf("[%s] %s was %s and is %s", then->group, *key, was, is));
    }
    for (const char *const *key = config_keys(now); *key; key++)
        if (!config_value(then, *key, NULL))
            g_ptr_array_add(ret, g_strdup_printf("[%s] %s was not given and is %s", now->group,
                                                 *key, config_value(now, *key, NULL)));
}

static void compare_rigs(const Config *then, const Config *now, GPtrArray *ret) {
    gsize n;
    const struct config_section *sections = config_sections(then, &n);
    for (gsize i = 0; i < n; i++) {
        const struct config_section *other =
            config_find(now, sections[i].class_name, sections[i].name);
        if (other)
            compare_section(&sections[i], other, ret);
        else
            g_ptr_array_add(ret, g_strdup_printf("[%s] is not there now", sections[i].group));
    }
    sections = config_sections(now, &n);
    for (gsize i = 0; i < n; i++)
        if (!config_find(then, sections[i].class_name, sections[i].name))
            g_ptr_array_add(ret, g_strdup_printf("[%s] is new", sections[i].group));
}

char *capture_check_options(Session *session, const struct devices *devices) {
    g_autofree char *text = session_text(session, "rig.conf", NULL);
    g_autoptr(Config) then = text ? config_parse(text, session_path(session), NULL) : NULL;
    g_autoptr(Config) now =
        devices->text ? config_parse(devices->text, session_path(session), NULL) : NULL;
    g_autoptr(GPtrArray) changes = g_ptr_array_new_with_free_func(g_free);
    if (!then || !now)
        return NULL;
    compare_rigs(then, now, changes);
    const guint n = changes->len;
    if (n == 0)
        return NULL;
    g_ptr_array_set_size(changes, (gint)MIN(n, SHOWN_CHANGES));
    g_ptr_array_add(changes, NULL);
    g_autofree char *list = g_strjoinv(", ", (char **)changes->pdata);
    g_autofree char *more =
        n > SHOWN_CHANGES ? g_strdup_printf(", and %u more", n - SHOWN_CHANGES) : g_strdup("");
    return g_strdup_printf(
        "The rig file has changed since the session was begun: %s%s. Frames from "
        "before and after the change may not fit together: restore the rig file, or begin a new "
        "session.",
        list, more);
}

char *capture_check_devices_text(const struct devices *devices) {
    g_autoptr(GPtrArray) lines = devices_identities(devices);
    g_ptr_array_add(lines, NULL);
    return g_strjoinv("\n", (char **)lines->pdata);
}

char *capture_check_devices(Session *session, const struct devices *devices) {
    g_autofree char *text = session_value(session, CAPTURE_DEVICES_KEY);
    g_auto(GStrv) then = g_strsplit(text ? text : "", "\n", -1);
    g_autoptr(GPtrArray) now = devices_identities(devices);
    g_autoptr(GString) changes = g_string_new(NULL);
    for (char **line = then; *line; line++) {
        const char *was = strstr(*line, ": ");
        for (guint i = 0; was && i < now->len; i++) {
            const char *is = now->pdata[i];
            const gsize named = (gsize)(was + 2 - *line);
            if (strncmp(*line, is, named) == 0 && strcmp(*line, is) != 0)
                g_string_append_printf(changes, "%s%.*s was %s and is %s",
                                       changes->len > 0 ? "; " : "", (int)named - 2, *line, was + 2,
                                       is + named);
        }
    }
    if (changes->len == 0)
        return NULL;
    return g_strdup_printf(
        "Other devices answer than when the session was begun: %s. Frames from "
        "before and after the change may not fit together: put the earlier device "
        "back, or begin a new session.",
        changes->str);
}

char *capture_check_calibration(Session *session, const struct devices *devices) {
    g_autofree char *text = session_text(session, "calibration.conf", NULL);
    g_autofree char *begun_with = session_value(session, "calibration");
    g_autoptr(GPtrArray) warnings = NULL;
    struct devices then = *devices;
    if (begun_with && g_path_is_absolute(begun_with))
        then.calibration_path = begun_with; /* the rig file may now name another calibration */
    g_autoptr(Calibration) now = capture_calibration(&then, &warnings, NULL);
    g_autofree char *now_text = now ? calibration_to_text(now) : NULL;
    if (g_strcmp0(text, now_text) == 0)
        return NULL;
    return g_strdup(
        "The rig's geometry or calibration is not the one with which the session was begun. "
        "Processing uses the one of the beginning, so frames from after the change may not fit: "
        "restore the calibration, or begin a new session.");
}
