/* Compares pictures pixel by pixel with CIEDE2000 in L*a*b*, and as a whole with PSNR, SSIM and
 * FLIP. */
#include "compare_pictures.h"

#include <math.h>
#include <stdlib.h>

#include "base/data_error.h"
#include "base/robust.h"
#include "exr/exr.h"
#include "import_private.h"
#include "metrics/delta_e.h"
#include "metrics/flip.h"
#include "metrics/psnr.h"
#include "metrics/ssim.h"

#define COLOURS 3

/* Sets values that are not finite to 0. Masked pixels have such values. */
static void hide_unknown(struct import_picture *picture) {
    const gsize n = COLOURS * (gsize)picture->width * (gsize)picture->height;
    for (gsize i = 0; i < n; i++)
        picture->rgb[i] = isfinite(picture->rgb[i]) ? picture->rgb[i] : 0;
}

static void compare_as_shown(const struct import_picture *a, const struct import_picture *b,
                             struct picture_comparison *ret) {
    const int width = a->width, height = a->height;
    gboolean bright = FALSE;
    for (gsize i = 0; !bright && i < COLOURS * (gsize)width * (gsize)height; i++)
        bright = a->rgb[i] > 1;
    ret->psnr_db = psnr(a->rgb, b->rgb, width, height);
    ret->ssim = ssim(a->rgb, b->rgb, width, height);
    ret->flip = flip_ldr(a->rgb, b->rgb, width, height, FLIP_PIXELS_PER_DEGREE, NULL);
    ret->flip_hdr =
        bright ? flip_hdr(a->rgb, b->rgb, width, height, FLIP_PIXELS_PER_DEGREE, NULL) : NAN;
}

gboolean compare_pictures(const char *a, const char *b, struct picture_comparison *ret,
                          GError **error) {
    g_autoptr(ImportPicture) first = import_picture_read(a, PICTURE_TONES_UNSAID, error);
    g_autoptr(ImportPicture) second =
        first ? import_picture_read(b, PICTURE_TONES_UNSAID, error) : NULL;
    if (!second)
        return FALSE;
    if (first->width != second->width || first->height != second->height) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s has %d × %d pixels, but %s has %d × %d; give two pictures of the same size",
                    a, first->width, first->height, b, second->width, second->height);
        return FALSE;
    }
    const gsize n = (gsize)first->width * (gsize)first->height;
    hide_unknown(first);
    hide_unknown(second);
    g_autofree double *different = g_new(double, n);
    double all = 0, sum = 0;
    gsize found = 0;
    for (gsize i = 0; i < n; i++) {
        const float *p = first->rgb + i * COLOURS, *q = second->rgb + i * COLOURS;
        double p_lab[COLOURS], q_lab[COLOURS];
        delta_e_lab(p, p_lab);
        delta_e_lab(q, q_lab);
        const double delta_e = delta_e_2000(p_lab, q_lab);
        all += delta_e;
        if (p[0] == q[0] && p[1] == q[1] && p[2] == q[2])
            continue;
        sum += delta_e;
        different[found++] = delta_e;
    }
    qsort(different, found, sizeof *different, robust_by_value);
    ret->width = first->width;
    ret->height = first->height;
    ret->delta_e = all / (double)n;
    ret->delta_e_different = found > 0 ? sum / (double)found : 0;
    ret->p95 = found > 0 ? different[(gsize)(0.95 * (double)(found - 1))] : 0;
    ret->largest = found > 0 ? different[found - 1] : 0;
    ret->different = (double)found / (double)n;
    compare_as_shown(first, second, ret);
    return TRUE;
}

gboolean compare_is_picture(const char *path) {
    g_autofree char *lower = g_ascii_strdown(path, -1);
    const char *kind = NULL;
    if (!g_str_has_suffix(lower, ".exr"))
        return import_is_picture(path);
    g_autoptr(ExrFile) file = exr_read_headers(path, NULL);
    return file && file->parts->len == 1 &&
           exr_get_string(file->parts->pdata[0], COMPARE_PICTURE_KIND, &kind, NULL) &&
           g_str_equal(kind, "picture");
}
