/* Measures the photon transfer from the raw exposures that a capture keeps on request: pairs of
 * frames with the same exposure, in the dark and under a lamp. */
#include "tile_noise.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "exr/exr.h"

#define MAX_PAIRS 16

struct pairs {
    struct transfer_pair pair[MAX_PAIRS];
    GPtrArray *parts; /* owns the pixels */
    int n, bits;
};

static struct exr_part *read_raw(const char *path, const struct rig_camera *camera, double *ret_us,
                                 int *ret_bits, GError **error) {
    struct exr_part *part = exr_read_part(path, "frame", error);
    if (part && exr_get_double(part, "mesorig.exposure_us", ret_us, error) &&
        exr_get_int(part, "mesorig.bits", ret_bits, error)) {
        if (part->width != camera->width || part->height != camera->height)
            g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_DATA,
                        "%s: the frame has %d × %d pixels, but camera %s has %d × %d; capture the "
                        "frame again",
                        path, part->width, part->height, camera->name, camera->width,
                        camera->height);
        else if (*ret_bits < 8 || *ret_bits > 16)
            g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_DATA,
                        "%s: the frame has %d bits per pixel, but must have 8 to 16; capture the "
                        "frame again",
                        path, *ret_bits);
        else if (!exr_part_plane(part, "Y"))
            g_set_error(error, TRANSFER_ERROR, TRANSFER_ERROR_DATA,
                        "%s: the frame lacks channel Y; capture the frame again", path);
        else
            return part;
    }
    exr_part_free(part);
    return NULL;
}

static void free_part(gpointer part) {
    exr_part_free(part);
}

/* Reads at most MAX_PAIRS pairs, one for each exposure. The first two of consecutive frames with
 * equal exposures are a pair. */
static gboolean read_pairs(const char *folder, const struct rig_camera *camera, struct pairs *ret,
                           GError **error) {
    struct exr_part *before = NULL;
    double us = 0, before_us = 0;
    *ret = (struct pairs){.parts = g_ptr_array_new_with_free_func(free_part)};
    for (int k = 0; ret->n < MAX_PAIRS; k++, before_us = us) {
        g_autofree char *path = g_strdup_printf("%s/%04d.exr", folder, k);
        if (!g_file_test(path, G_FILE_TEST_EXISTS))
            break;
        struct exr_part *part = read_raw(path, camera, &us, &ret->bits, error);
        if (!part) {
            exr_part_free(before);
            return FALSE;
        }
        gboolean has_pair = FALSE;
        for (int i = 0; i < ret->n; i++)
            has_pair |= ret->pair[i].exposure_us == us;
        if (before && us == before_us && !has_pair) {
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

/* Finds the pairs of exposures of camera c in the brightest shot of a kind that has kept exposures.
 * ret->n is 0 if there is no such shot. */
static gboolean find_pairs(Session *session, const GPtrArray *shots, enum session_shot_kind kind,
                           int c, const struct rig_camera *camera, struct pairs *ret,
                           GError **error) {
    const gsize n = (gsize)camera->width * (gsize)camera->height;
    double best = -HUGE_VAL;
    *ret = (struct pairs){0};
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind != kind || shot->state != SHOT_DONE || !camera_set_has(shot->cameras, c))
            continue;
        g_autofree char *relative = session_frame_path(shot, camera->name);
        g_autofree char *folder = session_file(session, relative);
        folder[strlen(folder) - strlen(".exr")] = '\0';
        struct pairs found;
        if (!g_file_test(folder, G_FILE_TEST_IS_DIR))
            continue;
        gboolean ok = read_pairs(folder, camera, &found, error);
        double sum = 0, mean = -HUGE_VAL;
        for (gsize p = 0; ok && found.n > 0 && p < n; p++)
            sum += found.pair[0].first[p];
        if (ok && found.n > 0)
            mean = sum / (double)n;
        struct pairs darker = mean > best ? *ret : found;
        *ret = mean > best ? found : *ret;
        best = MAX(best, mean);
        g_clear_pointer(&darker.parts, g_ptr_array_unref);
        if (!ok)
            return FALSE;
    }
    return TRUE;
}

/* a camera without pairs in the dark or under a lamp is left out */
gboolean tile_noise(Session *session, struct calibration *calibration, const GPtrArray *shots,
                    int *ret_n, GError **error) {
    gboolean ok = TRUE;
    *ret_n = 0;
    for (int c = 0; ok && c < calibration->rig.n_cameras; c++) {
        const struct rig_camera *camera = &calibration->rig.cameras[c];
        struct pairs dark = {0}, lit = {0};
        ok = find_pairs(session, shots, SHOT_DARK, c, camera, &dark, error) &&
             find_pairs(session, shots, SHOT_LAMP, c, camera, &lit, error);
        if (ok && dark.n > 0 && lit.n > 0) {
            struct transfer_sensor sensor = {camera->width, camera->height, lit.bits};
            ok = transfer_fit(&sensor, dark.pair, dark.n, lit.pair, lit.n,
                              &calibration->noise[c].transfer, error);
            if (ok)
                calibration->noise[c].known = TRUE;
            else
                g_prefix_error(error, "camera %s: ", camera->name);
            *ret_n += ok;
        }
        g_clear_pointer(&dark.parts, g_ptr_array_unref);
        g_clear_pointer(&lit.parts, g_ptr_array_unref);
    }
    return ok;
}
