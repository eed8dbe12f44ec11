/* Photon transfer from the raw exposures that a capture keeps on request: pairs of frames with
 * the same exposure, in the dark and under a lamp. */
#include "tile_noise.h"

#include <math.h>
#include <string.h>

#include "exr/exr.h"

#define MOST_PAIRS 16

struct pairs {
    struct transfer_pair pair[MOST_PAIRS];
    GPtrArray *parts; /* owner of the pixels */
    int n, bits;
};

static void pairs_clear(struct pairs *pairs) {
    g_clear_pointer(&pairs->parts, g_ptr_array_unref);
}

static void free_part(gpointer part) {
    exr_part_free(part);
}

static char *folder_of(Session *session, const struct session_shot *shot, const char *camera) {
    g_autofree char *relative = session_frame_path(shot, camera);
    char *path = session_file(session, relative);
    path[strlen(path) - strlen(".exr")] = '\0';
    return path;
}

static struct exr_part *read_raw(const char *folder, int k, double *ret_us, int *ret_bits,
                                 GError **error) {
    g_autofree char *path = g_strdup_printf("%s/%04d.exr", folder, k);
    struct exr_part *part = exr_read_part(path, "frame", error);
    if (part && exr_get_double(part, "mesorig.exposure_us", ret_us, error) &&
        exr_get_int(part, "mesorig.bits", ret_bits, error) && *ret_bits >= 8 && *ret_bits <= 16 &&
        exr_part_plane(part, "Y"))
        return part;
    exr_part_free(part);
    return NULL;
}

/* NULL without an error: there is no such exposure. */
static struct exr_part *read_checked(const char *folder, int k, const struct rig_camera *camera,
                                     double *ret_us, int *ret_bits, GError **error) {
    struct exr_part *part = read_raw(folder, k, ret_us, ret_bits, error);
    if (!part || (part->width == camera->width && part->height == camera->height))
        return part;
    g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_DATA,
                "%s/%04d.exr: %d × %d pixels, but camera %s has %d × %d", folder, k, part->width,
                part->height, camera->name, camera->width, camera->height);
    exr_part_free(part);
    return NULL;
}

static gboolean has_pair(const struct pairs *pairs, double exposure_us) {
    for (int i = 0; i < pairs->n; i++)
        if (pairs->pair[i].exposure_us == exposure_us)
            return TRUE;
    return FALSE;
}

/* Of consecutive frames with equal exposure takes the first two as a pair. */
static gboolean read_pairs(const char *folder, const struct rig_camera *camera, struct pairs *ret,
                           GError **error) {
    struct exr_part *before = NULL;
    double us = 0, before_us = 0;
    *ret = (struct pairs){.parts = g_ptr_array_new_with_free_func(free_part)};
    for (int k = 0; ret->n < MOST_PAIRS; k++, before_us = us) {
        g_autofree char *path = g_strdup_printf("%s/%04d.exr", folder, k);
        if (!g_file_test(path, G_FILE_TEST_EXISTS))
            break;
        struct exr_part *part = read_checked(folder, k, camera, &us, &ret->bits, error);
        if (!part) {
            exr_part_free(before);
            return FALSE;
        }
        if (before && us == before_us && !has_pair(ret, us)) {
            ret->pair[ret->n++] =
                (struct transfer_pair){us, exr_part_plane(before, "Y"), exr_part_plane(part, "Y")};
            g_ptr_array_add(ret->parts, before);
            g_ptr_array_add(ret->parts, part);
            before = NULL;
        } else {
            exr_part_free(before);
            before = part;
        }
    }
    exr_part_free(before);
    return TRUE;
}

static double tile_noise_mean_of(const struct transfer_pair *pair,
                                 const struct rig_camera *camera) {
    gsize n = (gsize)camera->width * (gsize)camera->height;
    double sum = 0;
    for (gsize i = 0; i < n; i++)
        sum += pair->first[i];
    return sum / (double)n;
}

/* The pairs of the brightest shot of a kind. */
static gboolean find_pairs(Session *session, const GPtrArray *shots, enum session_shot_kind kind,
                           int c, const struct rig_camera *camera, struct pairs *ret,
                           GError **error) {
    double best = -HUGE_VAL;
    *ret = (struct pairs){0};
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != kind || shot->state != SHOT_DONE || !(shot->cameras >> c & 1))
            continue;
        g_autofree char *folder = folder_of(session, shot, camera->name);
        struct pairs found;
        if (!g_file_test(folder, G_FILE_TEST_IS_DIR))
            continue;
        gboolean ok = read_pairs(folder, camera, &found, error);
        double mean = ok && found.n > 0 ? tile_noise_mean_of(&found.pair[0], camera) : -HUGE_VAL;
        if (mean > best) {
            best = mean;
            pairs_clear(ret);
            *ret = found;
        } else {
            pairs_clear(&found);
        }
        if (!ok)
            return FALSE;
    }
    return TRUE;
}

/* Fits one camera; cameras without pairs are skipped. */
static gboolean fit_camera(Session *session, struct calibration *calibration,
                           const GPtrArray *shots, int c, int *n, GError **error) {
    const struct rig_camera *camera = &calibration->rig.cameras[c];
    struct pairs dark = {0}, lit = {0};
    gboolean ok = find_pairs(session, shots, SHOT_DARK, c, camera, &dark, error) &&
                  find_pairs(session, shots, SHOT_LAMP, c, camera, &lit, error);
    if (ok && dark.n > 0 && lit.n > 0) {
        struct transfer_sensor sensor = {camera->width, camera->height, lit.bits};
        ok = transfer_fit(&sensor, dark.pair, dark.n, lit.pair, lit.n,
                          &calibration->noise[c].transfer, error);
        if (ok)
            calibration->noise[c].known = TRUE;
        else
            g_prefix_error(error, "camera %s: ", camera->name);
        *n += ok;
    }
    pairs_clear(&dark);
    pairs_clear(&lit);
    return ok;
}

gboolean tile_noise(Session *session, struct calibration *calibration, const GPtrArray *shots,
                    int *ret_n, GError **error) {
    *ret_n = 0;
    for (int c = 0; c < calibration->rig.n_cameras; c++)
        if (!fit_camera(session, calibration, shots, c, ret_n, error))
            return FALSE;
    return TRUE;
}
