/* Compares pictures pixel by pixel with CIEDE2000 in L*a*b*. */
#include "compare_pictures.h"

#include <stdlib.h>

#include "base/data_error.h"
#include "codec/compare.h"
#include "exr/exr.h"
#include "import_private.h"

#define COLOURS 3

static double pixel_delta_e(const float *a, const float *b) {
    double lab[2][COLOURS];
    compare_lab(a, lab[0]);
    compare_lab(b, lab[1]);
    return compare_delta_e(lab[0], lab[1]);
}

static int compare_pictures_by_size(gconstpointer a, gconstpointer b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static gboolean compare_pictures_same(const float *p, const float *q) {
    return p[0] == q[0] && p[1] == q[1] && p[2] == q[2];
}

static void compare_pictures_summarise(const float *a, const float *b,
                                       struct picture_comparison *ret) {
    const gsize n = (gsize)ret->width * (gsize)ret->height;
    g_autofree double *different = g_new(double, n);
    double all = 0, sum = 0;
    gsize found = 0;
    for (gsize i = 0; i < n; i++) {
        const float *p = a + i * COLOURS, *q = b + i * COLOURS;
        const double delta_e = pixel_delta_e(p, q);
        all += delta_e;
        if (compare_pictures_same(p, q))
            continue;
        sum += delta_e;
        different[found++] = delta_e;
    }
    qsort(different, found, sizeof *different, compare_pictures_by_size);
    ret->delta_e = all / (double)n;
    ret->delta_e_different = found > 0 ? sum / (double)found : 0;
    ret->p95 = found > 0 ? different[(gsize)(0.95 * (double)(found - 1))] : 0;
    ret->largest = found > 0 ? different[found - 1] : 0;
    ret->different = (double)found / (double)n;
}

gboolean compare_pictures(const char *a, const char *b, struct picture_comparison *ret,
                          GError **error) {
    struct import_picture *first = import_picture_read(a, error);
    struct import_picture *second = first ? import_picture_read(b, error) : NULL;
    gboolean ok = second != NULL;
    if (ok && (first->width != second->width || first->height != second->height)) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s has %d × %d pixels, but %s has %d × %d: render them alike", a, first->width,
                    first->height, b, second->width, second->height);
        ok = FALSE;
    }
    if (ok) {
        ret->width = first->width;
        ret->height = first->height;
        compare_pictures_summarise(first->rgb, second->rgb, ret);
    }
    import_picture_free(first);
    import_picture_free(second);
    return ok;
}

gboolean compare_is_picture(const char *path) {
    const char *kind = NULL;
    if (!g_str_has_suffix(path, ".exr"))
        return import_is_picture(path);
    struct exr_file *file = exr_read_headers(path, NULL);
    const gboolean is = file && file->parts->len == 1 &&
                        exr_get_string(file->parts->pdata[0], COMPARE_PICTURE_KIND, &kind, NULL) &&
                        g_str_equal(kind, "picture");
    exr_file_free(file);
    return is;
}
