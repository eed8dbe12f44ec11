#include "mdf_table.h"

#include "exr/exr.h"

#include <math.h>
#include <string.h>

#define DEG     (G_PI / 180.0)
#define MAX_MM  6e4
#define AGAIN   "; process the session again, or copy the file again"
#define MIN_COS 0.02
#define BINS    4096 /* number of cells of the histogram of differences */

G_DEFINE_QUARK(mdf_table_error, mdf_table_error)

G_GNUC_PRINTF(3, 4)
static gboolean mdf_table_fail(GError **error, const struct exr_part *part, const char *format,
                               ...) {
    va_list list;
    va_start(list, format);
    g_autofree char *what = g_strdup_vprintf(format, list);
    va_end(list);
    g_set_error(error, MDF_TABLE_ERROR, MDF_TABLE_ERROR_FORMAT, "part “%s”: %s" AGAIN, part->name,
                what);
    return FALSE;
}

/* Holes are filled in rounds. In each round, a hole gets the mean of those of its eight neighbours
 * that are known. The tile repeats. */
void mdf_table_fill(float *depth, int w, int h) {
    g_autofree float *before = g_new(float, (gsize)w *h);
    for (int missing = 1; missing > 0;) {
        memcpy(before, depth, sizeof(float) * (gsize)w * h);
        missing = 0;
        for (int hole = 0; hole < w * h; hole++) {
            const int i = hole % w, j = hole / w;
            float sum = 0.0f;
            int n = 0;
            if (before[hole] >= 0.0f)
                continue;
            for (int k = 0; k < 9; k++) {
                int x = (i + k % 3 - 1 + w) % w, y = (j + k / 3 - 1 + h) % h;
                float near = before[y * w + x];
                sum += near >= 0.0f ? near : 0.0f;
                n += near >= 0.0f;
            }
            depth[hole] = n > 0 ? sum / n : -1.0f;
            missing += n == 0;
        }
    }
}

/* Reads a view's distances and converts them to depths: the distance along the ray times cos θ. If
 * the camera's position is known, θ is the angle between the normal and the ray through the texel.
 * If not, θ is that of the view. */
static gboolean mdf_table_add_view(struct mdf_table *t, int view, const struct exr_part *part,
                                   double reference_mm, GError **error) {
    const float *distance = exr_part_plane(part, "D");
    gsize n = (gsize)t->width * t->height, seen = 0;
    float *depth = t->depth_mm + view * n;
    double theta, phi, centre[3], scale = 1.0;
    if (distance == NULL)
        return mdf_table_fail(error, part, "it lacks channel D with the distances");
    if (part->width != t->width || part->height != t->height)
        return mdf_table_fail(error, part, "it has %d × %d texels, but the first view has %d × %d",
                              part->width, part->height, t->width, t->height);
    if (!exr_get_double(part, "view.theta_deg", &theta, error) ||
        !exr_get_double(part, "view.phi_deg", &phi, error))
        return FALSE;
    t->theta_deg[view] = theta;
    t->phi_deg[view] = phi;
    if (exr_get_double(part, "mesorig.scale_mm", &scale, NULL) && !(scale > 0.0 && scale < MAX_MM))
        return mdf_table_fail(
            error, part, "mesorig.scale_mm is %g, but must be above 0 and below %g", scale, MAX_MM);
    /* Files without a camera position are treated as seen from a distant camera. */
    gboolean near = exr_get_v3d(part, "view.centre_mm", centre, NULL) && centre[2] > reference_mm;
    double cosine = MAX(cos(theta * DEG), MIN_COS);
    for (gsize k = 0; k < n; k++) {
        if (near) {
            const gsize j = k / t->width;
            const double row = (double)j, column = (double)(k % t->width);
            const double x = (column + 0.5 - 0.5 * t->width) * t->texel_mm;
            const double y = (0.5 * t->height - row - 0.5) * t->texel_mm;
            const double up = centre[2] - reference_mm;
            cosine = MAX(up / hypot(hypot(centre[0] - x, centre[1] - y), up), MIN_COS);
        }
        if (!(fabs(distance[k] * scale) <= MAX_MM))
            return mdf_table_fail(
                error, part,
                "the distance in column %zu and row %zu, counted from 0, is %g mm, "
                "but must be −%g to %g mm",
                k % (gsize)t->width, k / (gsize)t->width, distance[k] * scale, MAX_MM, MAX_MM);
        depth[k] = distance[k] >= 0.0f ? distance[k] * scale * cosine : -1.0f;
        t->seen[view * n + k] = distance[k] >= 0.0f;
        seen += distance[k] >= 0.0f;
        t->deepest_mm = MAX(t->deepest_mm, (double)depth[k]);
    }
    if (seen == 0) {
        g_set_error(error, MDF_TABLE_ERROR, MDF_TABLE_ERROR_FORMAT,
                    "part “%s”: no laser position saw a texel of this view; capture its laser "
                    "sweeps again or, if the file is damaged, copy it again",
                    part->name);
        return FALSE;
    }
    mdf_table_fill(depth, t->width, t->height);
    return TRUE;
}

struct mdf_table *mdf_table_new(int width, int height, int n_views, double texel_mm,
                                const float *theta_deg, const float *phi_deg) {
    const gsize angles = sizeof(float) * (gsize)n_views;
    struct mdf_table *t = g_new0(struct mdf_table, 1);
    *t = (struct mdf_table){
        .width = width,
        .height = height,
        .n_views = n_views,
        .n_measured = n_views,
        .texel_mm = texel_mm,
        .theta_deg = theta_deg ? g_memdup2(theta_deg, angles) : g_malloc0(angles),
        .phi_deg = phi_deg ? g_memdup2(phi_deg, angles) : g_malloc0(angles),
        .depth_mm = g_new(float, (gsize)width *(gsize)height *(gsize)n_views),
    };
    return t;
}

struct mdf_table *mdf_table_copy_measured(const struct mdf_table *table) {
    const int n_views = table->n_measured > 0 ? table->n_measured : table->n_views;
    const gsize n = (gsize)table->width * table->height * n_views;
    struct mdf_table *copy = mdf_table_new(table->width, table->height, n_views, table->texel_mm,
                                           table->theta_deg, table->phi_deg);
    memcpy(copy->depth_mm, table->depth_mm, sizeof(float) * n);
    copy->deepest_mm = table->deepest_mm;
    copy->seen = table->seen != NULL ? g_memdup2(table->seen, n) : NULL;
    return copy;
}

struct mdf_table *mdf_table_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    if (file == NULL)
        return NULL;
    const struct exr_part *first = file->parts->len > 0 ? file->parts->pdata[0] : NULL;
    g_autoptr(MdfTable) t = NULL;
    double texel_mm, reference_mm = 0.0;
    gboolean good = FALSE;
    if (first == NULL) {
        g_set_error(error, MDF_TABLE_ERROR, MDF_TABLE_ERROR_FORMAT, "the file has no view" AGAIN);
    } else if ((gint64)first->width * first->height * file->parts->len > MDF_TABLE_MAX_TEXELS) {
        g_set_error(error, MDF_TABLE_ERROR, MDF_TABLE_ERROR_FORMAT,
                    "%d × %d texels of %u views are too many: all views together may have at most "
                    "%d texels; process the session with fewer texels",
                    first->width, first->height, file->parts->len, MDF_TABLE_MAX_TEXELS);
    } else if (exr_get_double(first, "texel_mm", &texel_mm, error)) {
        t = mdf_table_new(first->width, first->height, file->parts->len, texel_mm, NULL, NULL);
        t->seen = g_new0(guint8, (gsize)t->width * t->height * t->n_views);
        exr_get_double(first, "reference_mm", &reference_mm, NULL);
        good = (texel_mm > 0.0 && texel_mm < MAX_MM) ||
               mdf_table_fail(error, first, "texel_mm is %g, but must be above 0 and below %g",
                              texel_mm, MAX_MM);
    }
    for (int k = 0; good && k < t->n_views; k++)
        good = mdf_table_add_view(t, k, file->parts->pdata[k], reference_mm, error);
    exr_file_free(file);
    if (good)
        return g_steal_pointer(&t);
    g_prefix_error(error, "%s: ", path);
    return NULL;
}

void mdf_table_free(struct mdf_table *t) {
    if (t == NULL)
        return;
    g_free(t->theta_deg);
    g_free(t->phi_deg);
    g_free(t->depth_mm);
    g_free(t->seen);
    g_free(t);
}

/* Returns √(Σ (d − d')² / n), and gives the 99th percentile of |d − d'| from a histogram. */
double mdf_table_difference(const struct mdf_table *table, int n_measured,
                            const struct mdf_table *other, double *ret_most_mm) {
    const gsize n = (gsize)table->width * (gsize)table->height;
    g_autofree gint64 *bins = g_new0(gint64, BINS + 1);
    const double step = MAX(table->deepest_mm, 1e-6) / BINS;
    gint64 seen = 0, beyond = 0;
    double squares = 0;
    for (int v = 0; v < n_measured; v++)
        for (gsize x = 0; x < n; x++) {
            const gsize at = (gsize)v * n + x;
            const double off = fabs((double)table->depth_mm[at] - other->depth_mm[at]);
            if (table->seen != NULL && !table->seen[at])
                continue;
            squares += off * off;
            seen++;
            bins[(int)MIN(off / step, BINS)]++;
        }
    if (ret_most_mm) {
        int bin = BINS;
        while (bin > 0 && 100 * (beyond + bins[bin]) <= seen)
            beyond += bins[bin--];
        *ret_most_mm = (bin + 1) * step;
    }
    return seen > 0 ? sqrt(squares / (double)seen) : 0;
}
