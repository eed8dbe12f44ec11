#include "abrdf.h"

#include <cblas.h>
#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "btf/btf.h"
#include "btf/direction_grid.h"
#include "codecs/codecs.h"
#include "session_views.h"

#define GRID    DIRECTION_GRID_MAX
#define SAMPLES (GRID * GRID)

/* minimum of cos θ in f_r = B / (π cos θ), because f_r of low lights would otherwise be noise */
#define MIN_COSINE 0.05

struct Abrdf {
    struct abrdf_info info;
    double *sums;   /* n_views × n_lights × 3: first the sums of B, later the means of B */
    double *counts; /* number of values in each sum: n_views × n_lights */
    float *samples; /* SAMPLES (views) × SAMPLES (lights) × 3: f_r */
};

void abrdf_free(Abrdf *abrdf) {
    if (!abrdf)
        return;
    direction_list_clear(&abrdf->info.views);
    direction_list_clear(&abrdf->info.lights);
    g_free(abrdf->sums);
    g_free(abrdf->counts);
    g_free(abrdf->samples);
    g_free(abrdf);
}

const struct abrdf_info *abrdf_info(const Abrdf *abrdf) {
    return &abrdf->info;
}

/* Stores the sizes, directions and region of the material. Returns FALSE with an error if they are
 * not valid. */
static gboolean begin(Abrdf *abrdf, const char *path, int width, int height,
                      const struct direction_list *views, const struct direction_list *lights,
                      const struct import_region *region, GError **error) {
    struct abrdf_info *info = &abrdf->info;
    info->width = width;
    info->height = height;
    info->views = direction_list_copy(views);
    info->lights = direction_list_copy(lights);
    info->region = *region;
    struct import_region *r = &info->region;
    if (r->width == 0 && r->height == 0)
        *r = (struct import_region){0, 0, width, height};
    if (r->x < 0 || r->y < 0 || r->width < 1 || r->height < 1 || r->width > width - r->x ||
        r->height > height - r->y)
        return data_error_fail(
            path, 0, error,
            "the region of %d × %d texels from column %d, row %d does not lie within the %d × %d "
            "texels of the material; give a region within them",
            r->width, r->height, r->x, r->y, width, height);
    if (views->n < ABRDF_MIN_DIRECTIONS || lights->n < ABRDF_MIN_DIRECTIONS)
        return data_error_fail(path, 0, error,
                               "the material has %zu views and %zu lights, but a BRDF needs %d of "
                               "each or more (“export ptm” and “export relight” need one view)",
                               views->n, lights->n, ABRDF_MIN_DIRECTIONS);
    abrdf->sums = g_new0(double, views->n * lights->n * 3);
    abrdf->counts = g_new0(double, views->n * lights->n);
    return TRUE;
}

static void add(Abrdf *abrdf, gsize pair, const float rgb[3], gboolean hole) {
    if (hole || !isfinite(rgb[0]) || !isfinite(rgb[1]) || !isfinite(rgb[2])) {
        abrdf->info.holes++;
        return;
    }
    for (gsize c = 0; c < 3; c++)
        abrdf->sums[3 * pair + c] += (double)rgb[c];
    abrdf->counts[pair]++;
}

static gboolean add_picture(int view, int light, const float *const planes[4], gpointer data,
                            GError **error G_GNUC_UNUSED) {
    Abrdf *abrdf = data;
    const struct import_region *r = &abrdf->info.region;
    const gsize pair = (gsize)view * abrdf->info.lights.n + (gsize)light;
    for (int y = r->y; y < r->y + r->height; y++)
        for (int x = r->x; x < r->x + r->width; x++) {
            const gsize i = (gsize)y * (gsize)abrdf->info.width + (gsize)x;
            const float rgb[3] = {planes[0][i], planes[1][i], planes[2][i]};
            add(abrdf, pair, rgb, planes[3] && ((int)planes[3][i] & BTF_FLAG_HOLE));
        }
    return TRUE;
}

static gboolean read_session(Abrdf *abrdf, const char *path, const struct import_region *region,
                             const struct work *work, GError **error) {
    struct session_view_files files;
    const gint64 begun_us = g_get_monotonic_time();
    gboolean ok = session_view_files_open(&files, path, error) &&
                  begin(abrdf, path, files.grid.width, files.grid.height, &files.views,
                        &files.lights, region, error);
    const int n = ok ? (int)files.paths->len : 0;
    for (int view = 0; ok && view < n; view++)
        ok = session_view_files_read(&files, view, add_picture, abrdf, error) &&
             work_tell(work, "read", view + 1, n, begun_us, error);
    session_view_files_clear(&files);
    return ok;
}

static gboolean read_material(Abrdf *abrdf, const char *path, const struct import_region *region,
                              const struct work *work, GError **error) {
    g_autoptr(Material) material = material_open(path, work, error);
    if (!material)
        return FALSE;
    const struct btf_layout *layout = material_info(material)->layout;
    if (!begin(abrdf, path, (int)layout->width, (int)layout->height, &layout->views,
               &layout->lights, region, error))
        return FALSE;
    const struct import_region *r = &abrdf->info.region;
    const gint64 begun_us = g_get_monotonic_time();
    const gsize pairs = layout->views.n * layout->lights.n;
    g_autofree float *values = g_new(float, 3 * pairs);
    for (int y = 0; y < r->height; y++) {
        for (int x = 0; x < r->width; x++) {
            material_reconstruct(material, (r->y + y) * abrdf->info.width + r->x + x, values);
            for (gsize pair = 0; pair < pairs; pair++)
                add(abrdf, pair, values + 3 * pair, FALSE);
        }
        if (!work_tell(work, "read", y + 1, r->height, begun_us, error))
            return FALSE;
    }
    return TRUE;
}

/* Returns the index of the light nearest to `light` under which this view has a value, or −1 if
 * there is none. */
static gssize abrdf_nearest(const Abrdf *abrdf, const float *lights, gsize view, gsize light) {
    const gsize n = abrdf->info.lights.n;
    gssize nearest = -1;
    float most = -2;
    for (gsize l = 0; l < n; l++) {
        const float *a = lights + 3 * l, *b = lights + 3 * light;
        const float cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
        if (abrdf->counts[view * n + l] > 0 && cosine > most) {
            most = cosine;
            nearest = (gssize)l;
        }
    }
    return nearest;
}

/* Computes f_r, 3 × n_views × n_lights, from the sums. A pair without a value gets the value of the
 * nearest light. Returns NULL with an error if a view has no value at all. g_free() */
static float *reflectances(Abrdf *abrdf, const char *path, GError **error) {
    const gsize n_views = abrdf->info.views.n, n = abrdf->info.lights.n, pairs = n_views * n;
    g_autofree float *lights = direction_list_vectors(&abrdf->info.lights);
    g_autofree float *f = g_new(float, 3 * pairs);
    for (gsize pair = 0; pair < pairs; pair++) {
        const gssize nearest = abrdf_nearest(abrdf, lights, pair / n, pair % n);
        if (nearest < 0) {
            data_error_set(
                path, 0, error,
                "the view at θ %.4g°, φ %.4g° has no value in any of the texels that are "
                "exported; give a --region that the view has seen, or capture the view "
                "again",
                (double)abrdf->info.views.theta_deg[pair / n],
                (double)abrdf->info.views.phi_deg[pair / n]);
            return NULL;
        }
        const gsize from = pair / n * n + (gsize)nearest;
        const double cosine = MAX((double)lights[3 * (gsize)nearest + 2], MIN_COSINE);
        abrdf->info.filled += from != pair;
        for (gsize c = 0; c < 3; c++)
            f[c * pairs + pair] =
                (float)(abrdf->sums[3 * from + c] / abrdf->counts[from] / (G_PI * cosine));
    }
    return g_steal_pointer(&f);
}

/* Computes the samples of each colour, V · f · Lᵀ, with the operators V of views and L of lights
 * (direction_grid.h). */
static gboolean resample(Abrdf *abrdf, const float *f, GError **error) {
    const int n_views = (int)abrdf->info.views.n, n_lights = (int)abrdf->info.lights.n;
    const gsize pairs = abrdf->info.views.n * abrdf->info.lights.n;
    g_autofree float *of_views = direction_grid_operator(&abrdf->info.views, GRID, FALSE, error);
    g_autofree float *of_lights =
        of_views ? direction_grid_operator(&abrdf->info.lights, GRID, FALSE, error) : NULL;
    if (!of_lights)
        return FALSE;
    g_autofree float *half = g_new(float, (gsize)SAMPLES *(gsize)n_lights);
    g_autofree float *colour = g_new(float, (gsize)SAMPLES *SAMPLES);
    abrdf->samples = g_new(float, (gsize)3 * SAMPLES * SAMPLES);
    for (gsize c = 0; c < 3; c++) {
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasNoTrans, SAMPLES, n_lights, n_views, 1,
                    of_views, n_views, f + c * pairs, n_lights, 0, half, n_lights);
        cblas_sgemm(CblasRowMajor, CblasNoTrans, CblasTrans, SAMPLES, SAMPLES, n_lights, 1, half,
                    n_lights, of_lights, n_lights, 0, colour, SAMPLES);
        for (gsize i = 0; i < (gsize)SAMPLES * SAMPLES; i++)
            abrdf->samples[3 * i + c] = colour[i];
    }
    return TRUE;
}

/* A direction's four samples of the grid. */
struct place {
    int index[4];
    float weight[4];
};

static struct place place_of(const float direction[3]) {
    struct place ret;
    direction_grid_weights(GRID, direction, ret.index, ret.weight);
    return ret;
}

static void evaluate_at(const Abrdf *abrdf, const struct place *light, const struct place *view,
                        float ret[3]) {
    float sum[3] = {0, 0, 0};
    for (int v = 0; v < 4; v++)
        for (int l = 0; l < 4; l++) {
            const float weight = view->weight[v] * light->weight[l];
            const float *sample = abrdf->samples + 3 * (view->index[v] * SAMPLES + light->index[l]);
            sum[0] += weight * sample[0];
            sum[1] += weight * sample[1];
            sum[2] += weight * sample[2];
        }
    for (int c = 0; c < 3; c++)
        ret[c] = MAX(sum[c], 0);
}

void abrdf_evaluate(const float light[3], const float view[3], float ret[3], gpointer abrdf) {
    const struct place of_light = place_of(light), of_view = place_of(view);
    evaluate_at(abrdf, &of_light, &of_view, ret);
}

void abrdf_evaluate_both(const float a[3], const float b[3], float ret[2][3], gpointer abrdf) {
    const struct place of_a = place_of(a), of_b = place_of(b);
    evaluate_at(abrdf, &of_a, &of_b, ret[0]);
    evaluate_at(abrdf, &of_b, &of_a, ret[1]);
}

/* Sets info.error: the relative RMS difference between the interpolated B and the measured B. */
static void compare(Abrdf *abrdf, const float *f) {
    struct abrdf_info *info = &abrdf->info;
    const gsize n = info->lights.n, pairs = info->views.n * n;
    g_autofree float *lights = direction_list_vectors(&info->lights);
    g_autofree float *views = direction_list_vectors(&info->views);
    double differences = 0, squares = 0;
    for (gsize pair = 0; pair < pairs; pair++) {
        const float *light = lights + 3 * (pair % n);
        float rgb[3];
        abrdf_evaluate(light, views + 3 * (pair / n), rgb, abrdf);
        for (gsize c = 0; c < 3; c++) {
            const double b = (double)f[c * pairs + pair] * (double)light[2];
            const double difference = (double)rgb[c] * (double)light[2] - b;
            differences += difference * difference;
            squares += b * b;
        }
    }
    info->error = squares > 0 ? sqrt(differences / squares) : 0;
    double of_views = 0, of_lights = 0;
    for (gsize i = 0; i < info->views.n; i++)
        of_views = MAX(of_views, (double)info->views.theta_deg[i]);
    for (gsize i = 0; i < n; i++)
        of_lights = MAX(of_lights, (double)info->lights.theta_deg[i]);
    info->lowest_deg = MIN(of_views, of_lights);
}

Abrdf *abrdf_read(const char *path, const struct import_region *region, const struct work *work,
                  GError **error) {
    g_autoptr(Abrdf) abrdf = g_new0(struct Abrdf, 1);
    const gboolean ok = g_file_test(path, G_FILE_TEST_IS_DIR)
                            ? read_session(abrdf, path, region, work, error)
                            : read_material(abrdf, path, region, work, error);
    g_autofree float *f = ok ? reflectances(abrdf, path, error) : NULL;
    if (!f || !resample(abrdf, f, error))
        return NULL;
    compare(abrdf, f);
    return g_steal_pointer(&abrdf);
}
