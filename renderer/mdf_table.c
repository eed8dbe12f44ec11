#include "mdf_table.h"

#include "processing/exr.h"

#include <math.h>
#include <string.h>

#define DEG       (G_PI / 180.0)
#define MAX_MM    6e4
#define LEAST_COS 0.02

G_DEFINE_QUARK(mdf_table_error, mdf_table_error)

static gboolean fail(GError **error, const struct exr_part *part, const char *what) {
    g_set_error(error, MDF_TABLE_ERROR, MDF_TABLE_ERROR_FORMAT, "part “%s”: %s", part->name, what);
    return FALSE;
}

/* Takes the mean of those of its eight neighbours that are known, the tile repeated; round by
 * round, so that a hole closes from its edge. */
static int fill_round(float *depth, const float *before, int w, int h) {
    int missing = 0;
    for (int j = 0; j < h; j++)
        for (int i = 0; i < w; i++) {
            float sum = 0.0f;
            int n = 0;
            if (before[j * w + i] >= 0.0f)
                continue;
            for (int k = 0; k < 9; k++) {
                int x = (i + k % 3 - 1 + w) % w, y = (j + k / 3 - 1 + h) % h;
                float near = before[y * w + x];
                sum += near >= 0.0f ? near : 0.0f;
                n += near >= 0.0f;
            }
            depth[j * w + i] = n > 0 ? sum / n : -1.0f;
            missing += n == 0;
        }
    return missing;
}

void mdf_table_fill(float *depth, int w, int h) {
    g_autofree float *before = g_new(float, (gsize)w *h);
    do
        memcpy(before, depth, sizeof(float) * (gsize)w * h);
    while (fill_round(depth, before, w, h) > 0);
}

/* Of the angle between the normal and the ray through a texel of the reference plane. */
static double cosine_from(const struct mdf_table *t, gsize texel, const double centre[3],
                          double reference_mm) {
    gsize row = texel / t->width, column = texel % t->width;
    double x = ((double)column + 0.5 - 0.5 * t->width) * t->texel_mm;
    double y = (0.5 * t->height - (double)row - 0.5) * t->texel_mm;
    double up = centre[2] - reference_mm;
    return MAX(up / hypot(hypot(centre[0] - x, centre[1] - y), up), LEAST_COS);
}

static gboolean add_view(struct mdf_table *t, int view, const struct exr_part *part,
                         double reference_mm, GError **error) {
    const float *distance = exr_part_plane(part, "D");
    gsize n = (gsize)t->width * t->height, seen = 0;
    float *depth = t->depth_mm + view * n;
    double theta, phi, centre[3];
    if (distance == NULL)
        return fail(error, part, "there is no channel D");
    if (part->width != t->width || part->height != t->height)
        return fail(error, part, "it has another size than the first view");
    if (!exr_get_double(part, "view.theta_deg", &theta, error) ||
        !exr_get_double(part, "view.phi_deg", &phi, error))
        return FALSE;
    t->theta_deg[view] = theta;
    t->phi_deg[view] = phi;
    /* Files that do not say where the camera stood are of one far away. */
    gboolean near = exr_get_v3d(part, "view.centre_mm", centre, NULL) && centre[2] > reference_mm;
    double cosine = MAX(cos(theta * DEG), LEAST_COS);
    for (gsize k = 0; k < n; k++) {
        if (near)
            cosine = cosine_from(t, k, centre, reference_mm);
        if (!(fabsf(distance[k]) <= MAX_MM))
            return fail(error, part, "there is a distance that is not a number of millimetres");
        depth[k] = distance[k] >= 0.0f ? distance[k] * cosine : -1.0f;
        seen += distance[k] >= 0.0f;
        t->deepest_mm = MAX(t->deepest_mm, (double)depth[k]);
    }
    if (seen == 0)
        return fail(error, part, "no laser position saw any of it; capture it again");
    mdf_table_fill(depth, t->width, t->height);
    return TRUE;
}

static struct mdf_table *make(const struct exr_file *file, GError **error) {
    const struct exr_part *first = file->parts->len > 0 ? file->parts->pdata[0] : NULL;
    if (first == NULL ||
        (gint64)first->width * first->height * file->parts->len > MDF_TABLE_MAX_TEXELS) {
        g_set_error(error, MDF_TABLE_ERROR, MDF_TABLE_ERROR_FORMAT,
                    first == NULL ? "there is no view in it" : "it is too large");
        return NULL;
    }
    double reference_mm;
    struct mdf_table *t = g_new0(struct mdf_table, 1);
    t->width = first->width;
    t->height = first->height;
    t->n_views = file->parts->len;
    t->theta_deg = g_new(float, t->n_views);
    t->phi_deg = g_new(float, t->n_views);
    t->depth_mm = g_new(float, (gsize)t->width * t->height * t->n_views);
    gboolean good = exr_get_double(first, "texel_mm", &t->texel_mm, error);
    if (!exr_get_double(first, "reference_mm", &reference_mm, NULL))
        reference_mm = 0.0;
    if (good && !(t->texel_mm > 0.0 && t->texel_mm < MAX_MM))
        good = fail(error, first, "texel_mm is not a size");
    for (int k = 0; good && k < t->n_views; k++)
        good = add_view(t, k, file->parts->pdata[k], reference_mm, error);
    if (good)
        return t;
    mdf_table_free(t);
    return NULL;
}

struct mdf_table *mdf_table_read(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    struct mdf_table *table = file != NULL ? make(file, error) : NULL;
    if (file != NULL && table == NULL)
        g_prefix_error(error, "%s: ", path);
    exr_file_free(file);
    return table;
}

void mdf_table_free(struct mdf_table *t) {
    if (t == NULL)
        return;
    g_free(t->theta_deg);
    g_free(t->phi_deg);
    g_free(t->depth_mm);
    g_free(t);
}
