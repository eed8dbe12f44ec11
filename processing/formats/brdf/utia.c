#include "utia.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <sys/stat.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "base/srgb.h"
#include "exr/exr.h"

#define STEP_THETA_DEG 15.0
#define STEP_PHI_DEG   7.5
#define PIXELS         ((gsize)UTIA_SIDE * UTIA_SIDE)

struct utia {
    float values[3][PIXELS]; /* for each colour; the f_r of a pair is at light · UTIA_SIDE + view */
};

#define BYTES (3 * PIXELS * sizeof(double))

static gboolean fail_size(const char *path, gsize is, GError **error) {
    return data_error_fail(
        path, 0, error,
        "the file has %zu bytes, but a BRDF in UTIA's format has %zu: 3 × 288 × 288 numbers of 8 "
        "bytes (288 × 288 pairs of directions in three colours); copy the file again",
        is, BYTES);
}

static gboolean read_bin(struct utia *utia, const char *path, GError **error) {
    const gsize bytes = BYTES;
    gsize length;
    GError *found = NULL;
    GStatBuf status;
    if (g_stat(path, &status) == 0 && S_ISREG(status.st_mode) && status.st_size > (goffset)bytes)
        return fail_size(path, (gsize)status.st_size, error);
    g_autofree char *data = input_file_read(path, bytes, &length, &found);
    if (!data) {
        input_file_propagate(found, DATA_ERROR, DATA_ERROR_IO, DATA_ERROR_INVALID, error);
        return FALSE;
    }
    if (length != bytes)
        return fail_size(path, length, error);
    for (gsize c = 0; c < 3; c++)
        for (gsize i = 0; i < PIXELS; i++) {
            double value;
            memcpy(&value, data + (c * PIXELS + i) * sizeof value, sizeof value);
            utia->values[c][i] = (float)value;
        }
    return TRUE;
}

/* Returns the sum of the absolute differences between neighbouring rows, for the 48 rows from
 * `first` on. The sum is large if the rows are not alike. */
static double unlike(const struct utia *utia, gsize first) {
    double sum = 0;
    for (gsize c = 0; c < 3; c++)
        for (gsize i = first * UTIA_SIDE; i < (first + UTIA_PHIS - 1) * UTIA_SIDE; i++)
            sum += fabs((double)utia->values[c][i + UTIA_SIDE] - (double)utia->values[c][i]);
    return sum;
}

static void flip(struct utia *utia) {
    for (gsize c = 0; c < 3; c++)
        for (gsize y = 0; y < UTIA_SIDE / 2; y++)
            for (gsize x = 0; x < UTIA_SIDE; x++) {
                float *a = &utia->values[c][y * UTIA_SIDE + x];
                float *b = &utia->values[c][(UTIA_SIDE - 1 - y) * UTIA_SIDE + x];
                const float kept = *a;
                *a = *b;
                *b = kept;
            }
}

static gboolean read_exr(struct utia *utia, const char *path, GError **error) {
    static const char *const channels[] = {"R", "G", "B"};
    g_autoptr(ExrFile) headers = exr_read_headers(path, error);
    if (!headers)
        return FALSE;
    const struct exr_part *first = headers->parts->len ? headers->parts->pdata[0] : NULL;
    if (!first || first->width != UTIA_SIDE || first->height != UTIA_SIDE)
        return data_error_fail(path, 0, error,
                               "the picture has %d × %d pixels, but a BRDF in UTIA's format has "
                               "288 × 288; give the file of the BRDF as UTIA published it",
                               first ? first->width : 0, first ? first->height : 0);
    g_autoptr(ExrPart) part = exr_read_picture(path, error);
    if (!part)
        return FALSE;
    if (part->width != UTIA_SIDE || part->height != UTIA_SIDE || part->outside > 0)
        return data_error_fail(path, 0, error, "the picture is cropped; save the whole picture");
    for (gsize c = 0; c < 3; c++) {
        const float *plane = exr_part_plane(part, channels[c]);
        if (!plane)
            return data_error_fail(path, 0, error,
                                   "channel %s is missing; a BRDF in UTIA's format has R, G and B",
                                   channels[c]);
        memcpy(utia->values[c], plane, PIXELS * sizeof *plane);
    }
    if (unlike(utia, UTIA_SIDE - UTIA_PHIS) < unlike(utia, 0))
        flip(utia);
    return TRUE;
}

static float decode(float number, const struct brdf_coding *coding) {
    const double divide = coding && coding->divide > 0 ? coding->divide : 1;
    const double scale = coding && coding->scale > 0 ? coding->scale : 1;
    double value = MAX((double)number, 0) / divide;
    if (coding && coding->srgb)
        value = srgb_decode(value);
    return (float)(value * scale);
}

/* Replaces the values of the 48 directions of θ = 0 by their mean. For lights (rows), step is
 * UTIA_SIDE and other is 1. For views (columns), step is 1 and other is UTIA_SIDE. */
static void join_zenith(float *values, gsize step, gsize other) {
    for (gsize k = 0; k < UTIA_SIDE; k++) {
        double sum = 0;
        for (gsize i = 0; i < UTIA_PHIS; i++)
            sum += (double)values[k * other + i * step];
        for (gsize i = 0; i < UTIA_PHIS; i++)
            values[k * other + i * step] = (float)(sum / UTIA_PHIS);
    }
}

struct utia *utia_read(const char *path, const struct brdf_coding *coding, GError **error) {
    struct utia *utia = g_new(struct utia, 1);
    g_autofree char *lower = g_ascii_strdown(path, -1);
    gboolean ok =
        g_str_has_suffix(lower, ".exr") ? read_exr(utia, path, error) : read_bin(utia, path, error);
    gsize bad = 0;
    for (gsize c = 0; ok && c < 3; c++) {
        for (gsize i = 0; i < PIXELS; i++) {
            bad += !isfinite(utia->values[c][i]);
            utia->values[c][i] = decode(utia->values[c][i], coding);
        }
        join_zenith(utia->values[c], UTIA_SIDE, 1);
        join_zenith(utia->values[c], 1, UTIA_SIDE);
    }
    if (ok && bad > 0)
        ok = data_error_fail(path, 0, error,
                             "%zu of the %zu numbers are not finite; copy the file again", bad,
                             3 * PIXELS);
    if (!ok)
        g_clear_pointer(&utia, utia_free);
    return utia;
}

void utia_free(struct utia *utia) {
    g_free(utia);
}

/* Gives the four measured directions around a direction, and their weights. */
static void weights(const float direction[3], gsize ret_index[4], double ret_weight[4]) {
    const double flat = hypot((double)direction[0], (double)direction[1]);
    const double theta =
        MIN(atan2(flat, (double)direction[2]) * 180 / G_PI / STEP_THETA_DEG, UTIA_THETAS - 1.0);
    double phi = atan2((double)direction[1], (double)direction[0]) * 180 / G_PI / STEP_PHI_DEG;
    phi = phi < 0 ? phi + UTIA_PHIS : phi;
    const int i = CLAMP((int)theta, 0, UTIA_THETAS - 2), j = CLAMP((int)phi, 0, UTIA_PHIS - 1);
    const double a = theta - i, b = CLAMP(phi - j, 0, 1);
    for (int k = 0; k < 4; k++) {
        const int row = i + k / 2, column = (j + k % 2) % UTIA_PHIS;
        ret_index[k] = (gsize)row * UTIA_PHIS + (gsize)column;
        ret_weight[k] = (k / 2 ? a : 1 - a) * (k % 2 ? b : 1 - b);
    }
}

void utia_evaluate(const struct utia *utia, const float light[3], const float view[3],
                   float ret[3]) {
    gsize lights[4], views[4];
    double light_weights[4], view_weights[4];
    weights(light, lights, light_weights);
    weights(view, views, view_weights);
    for (gsize c = 0; c < 3; c++) {
        double sum = 0;
        for (int k = 0; k < 16; k++)
            sum += light_weights[k / 4] * view_weights[k % 4] *
                   (double)utia->values[c][lights[k / 4] * UTIA_SIDE + views[k % 4]];
        ret[c] = (float)sum;
    }
}
