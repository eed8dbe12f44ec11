#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/data_error.h"
#include "base/robust.h"
#include "exr/exr.h"
#include "formats/export_surface.h"
#include "integrate_normals.h"
#include "maps_private.h"

#define DIRECTIONS 16
#define REACH      48 /* maximum distance in texels at which the horizon is searched */
/* if the share of texels without a height is above this, an MDF is not used */
#define MAX_HOLES 0.5
#define TAIL      0.002 /* share of the heights at each end that are assumed to be wrong */
#define STEEPEST  0.1F  /* minimum z of a normal whose slope is integrated */

/* Sets the heights to those that “mesorig export height” writes. If too many texels have no such
 * height, only sets heights_from, so that the caller computes the heights from the normals. */
static gboolean maps_heights_mdf(struct maps *maps, const char *session, const struct work *work,
                                 GError **error) {
    const struct export_surface_options options = {.what = EXPORT_HEIGHT, .layered = TRUE};
    struct export_surface_result result;
    g_autofree char *folder = g_dir_make_tmp("mesorig-XXXXXX", error);
    if (!folder)
        return FALSE;
    g_autofree char *file = g_build_filename(folder, "height.exr", NULL);
    gboolean ok = export_surface(session, file, &options, work, &result, error);
    g_autoptr(ExrPart) part = ok ? exr_read_part(file, "height", error) : NULL;
    g_unlink(file);
    g_rmdir(folder);
    if (!part)
        return FALSE;
    if (part->width != maps->width || part->height != maps->height)
        return data_error_fail(
            session, 0, error,
            "the MDF has %d × %d texels, but the BTF has %d × %d; process the session again",
            part->width, part->height, maps->width, maps->height);
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    const float *z = exr_part_plane(part, "Z"), *count = exr_part_plane(part, "N");
    for (gsize i = 0; i < n; i++) {
        const gboolean hole = !(fabsf(count[i]) > 0);
        maps->heights_mm[i] = hole ? NAN : z[i];
        maps->height_holes += hole;
    }
    maps->heights_from = MAPS_HEIGHTS_MDF;
    if (maps->height_holes > MAX_HOLES * (double)n) {
        maps->heights_from = MAPS_HEIGHTS_NORMALS;
        maps->height_holes = 0;
    }
    return TRUE;
}

/* Clamps heights to the quantiles TAIL and 1 − TAIL, and shifts them so that the lowest is 0. */
static void limit(struct maps *maps) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    g_autofree double *sorted = g_new(double, n);
    for (gsize i = 0; i < n; i++)
        sorted[i] = (double)maps->heights_mm[i];
    qsort(sorted, n, sizeof *sorted, robust_by_value);
    const gsize tail = (gsize)(TAIL * (double)n);
    const float least = (float)sorted[tail], most = (float)sorted[n - 1 - tail];
    for (gsize i = 0; i < n; i++)
        maps->heights_mm[i] = CLAMP(maps->heights_mm[i], least, most) - least;
    maps->relief_mm = (double)most - (double)least;
}

static void normals(struct maps *maps) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    g_autofree float *p = g_new(float, n), *q = g_new(float, n);
    for (gsize i = 0; i < n; i++) {
        const float *normal = maps->fit->texels[i].normal;
        const float z = MAX(normal[2], STEEPEST);
        p[i] = -normal[0] / z;
        q[i] = -normal[1] / z;
    }
    integrate_normals(p, q, maps->width, maps->height, maps->texel_mm, maps->heights_mm);
}

gboolean maps_find_heights(struct maps *maps, const char *session, const struct work *work,
                           GError **error) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    g_autofree char *mdf = session ? g_build_filename(session, "products", "mdf.exr", NULL) : NULL;
    maps->heights_mm = g_new0(float, n);
    if (mdf && g_file_test(mdf, G_FILE_TEST_EXISTS)) {
        if (!maps_heights_mdf(maps, session, work, error))
            return FALSE;
    } else {
        maps->heights_from = MAPS_HEIGHTS_NORMALS;
    }
    if (maps->heights_from == MAPS_HEIGHTS_NORMALS)
        normals(maps);
    if (btf_fill_holes(&maps->heights_mm, 1, maps->width, maps->height) < 0)
        memset(maps->heights_mm, 0, sizeof(float) * n);
    limit(maps);
    return TRUE;
}

struct maps_occlusion {
    const float *heights;
    int width, height;
    float *ret;
};

/* Gives the height at a position in texels by bilinear interpolation. Returns FALSE if the position
 * is outside of the field. */
static gboolean maps_heights_at(const struct maps_occlusion *of, double x, double y, double *ret) {
    const int x0 = (int)floor(x), y0 = (int)floor(y);
    if (x0 < 0 || y0 < 0 || x0 + 1 >= of->width || y0 + 1 >= of->height)
        return FALSE;
    const float *row = of->heights + (gsize)y0 * (gsize)of->width + x0, *next = row + of->width;
    const double fx = x - x0, fy = y - y0;
    *ret = (1 - fy) * ((1 - fx) * (double)row[0] + fx * (double)row[1]) +
           fy * ((1 - fx) * (double)next[0] + fx * (double)next[1]);
    return TRUE;
}

static void occlusion_row(int y, gpointer data) {
    const struct maps_occlusion *of = data;
    for (int x = 0; x < of->width; x++) {
        const gsize at = (gsize)y * (gsize)of->width + (gsize)x;
        double sum = 0;
        for (int k = 0; k < DIRECTIONS; k++) {
            const double phi = (k + 0.5) * 2 * G_PI / DIRECTIONS, dx = cos(phi), dy = sin(phi);
            double steepest = 0, there;
            for (int r = 1; r <= REACH; r++) {
                if (!maps_heights_at(of, x + r * dx, y + r * dy, &there))
                    break;
                steepest = MAX(steepest, (there - (double)of->heights[at]) / r);
            }
            sum += 1 / (1 + steepest * steepest);
        }
        of->ret[at] = (float)(sum / DIRECTIONS);
    }
}

gboolean maps_find_occlusion(const float *heights, int width, int height, const struct work *work,
                             float *ret, GError **error) {
    struct maps_occlusion of = {heights, width, height, ret};
    return work_parallel(work, "occlusion", height, occlusion_row, &of, error);
}
