#include "relighting.h"

#include <math.h>

#include "base/data_error.h"
#include "btf/btf.h"
#include "btf/btf_matrix.h"
#include "formats/reflectance/session_views.h"
#include "metrics/flip.h"
#include "metrics/psnr.h"
#include "metrics/ssim.h"

void relighting_free(Relighting *relighting) {
    if (!relighting)
        return;
    near_field_free(relighting->near);
    g_free(relighting->lights);
    g_free(relighting->values);
    g_free(relighting);
}

struct reading {
    Relighting *to;
    const struct work *work;
    gint64 begun_us;
    float *planes[3]; /* R, G and B of a picture, n_texels each; NaN for holes */
};

/* Copies a picture to the values and fills its holes. */
static gboolean take_picture(int view G_GNUC_UNUSED, int light, const float *const planes[4],
                             gpointer data, GError **error) {
    struct reading *reading = data;
    Relighting *to = reading->to;
    const gsize n = (gsize)to->width * (gsize)to->height;
    float *values = to->values + 3 * n * (gsize)to->n_lights;
    gsize predicted = 0;
    for (gsize i = 0; planes[3] && i < n; i++)
        predicted += ((int)planes[3][i] & BTF_FLAG_PREDICTED) != 0;
    if (2 * predicted > n)
        return TRUE;
    to->lights[to->n_lights++] = light;
    for (gsize i = 0; i < n; i++) {
        gboolean hole = planes[3] && ((int)planes[3][i] & BTF_FLAG_HOLE);
        for (int c = 0; c < 3; c++)
            hole = hole || !isfinite(planes[c][i]);
        for (int c = 0; c < 3; c++)
            reading->planes[c][i] = hole ? NAN : planes[c][i];
    }
    const gboolean dark = btf_fill_holes(reading->planes, 3, to->width, to->height) < 0;
    for (gsize i = 0; i < 3 * n; i++)
        values[i] = dark ? 0 : reading->planes[i % 3][i / 3];
    return work_tell(reading->work, "read", light + 1, (int)to->near->lights.n, reading->begun_us,
                     error);
}

static gboolean read_view(Relighting *to, const char *path, const struct work *work,
                          GError **error) {
    struct session_view_files files = {0};
    const gsize n = (gsize)to->width * (gsize)to->height;
    g_autofree float *planes = g_new(float, 3 * n);
    struct reading reading = {
        to, work, g_get_monotonic_time(), {planes, planes + n, planes + 2 * n}};
    const gsize n_lights = to->near->lights.n;
    to->lights = g_new(int, n_lights);
    to->values = g_try_new(float, 3 * n * n_lights);
    if (!to->values)
        return data_error_fail(path, 0, error,
                               "there is no memory for a view of %.1f GiB; process the session "
                               "with fewer texels, or use a computer with more memory",
                               3 * (double)n * (double)n_lights * sizeof(float) / (1 << 30));
    const gboolean ok = session_view_files_open(&files, path, error) &&
                        session_view_files_read(&files, to->view, take_picture, &reading, error);
    session_view_files_clear(&files);
    return ok && (to->n_lights >= RELIGHTING_MIN_LIGHTS ||
                  data_error_fail(path, 0, error,
                                  "the session has pictures under %d lights; to predict each "
                                  "from the others, at least %d are needed; capture or import "
                                  "pictures under more lights",
                                  to->n_lights, RELIGHTING_MIN_LIGHTS));
}

Relighting *relighting_read(const char *path, const struct work *work, GError **error) {
    g_autoptr(Relighting) ret = g_new0(struct relighting, 1);
    ret->near = near_field_read(path, error);
    if (!ret->near)
        return NULL;
    for (gsize v = 1; v < ret->near->views.n; v++)
        if (ret->near->views.theta_deg[v] < ret->near->views.theta_deg[ret->view])
            ret->view = (int)v;
    ret->width = ret->near->grid.width;
    ret->height = ret->near->grid.height;
    return read_view(ret, path, work, error) ? g_steal_pointer(&ret) : NULL;
}

float *relighting_pictures(const Relighting *relighting) {
    const int n = relighting->width * relighting->height;
    float *ret = g_new(float, 3 * (gsize)n * (gsize)relighting->n_lights), *to = ret;
    const float *from = relighting->values;
    for (int light = 0; light < relighting->n_lights; light++)
        for (int texel = 0; texel < n; texel++) {
            const float f = (float)near_field_fall_off(relighting->near, relighting->view,
                                                       relighting->lights[light], texel);
            for (int c = 0; c < 3; c++)
                *to++ = f * *from++;
        }
    return ret;
}

struct comparing {
    const Relighting *relighting;
    const float *pictures, *predicted;
    double *square, *ssim, *flip; /* of each light */
};

static void compare_light(int light, gpointer data) {
    const struct comparing *c = data;
    const int width = c->relighting->width, height = c->relighting->height;
    const gsize at = 3 * (gsize)width * (gsize)height * (gsize)light;
    const float *a = c->pictures + at, *b = c->predicted + at;
    c->square[light] = psnr_mean_square(a, b, width, height);
    c->ssim[light] = ssim(a, b, width, height);
    c->flip[light] = flip_ldr(a, b, width, height, FLIP_PIXELS_PER_DEGREE, NULL);
}

void relighting_compare(const Relighting *relighting, const float *pictures, const float *predicted,
                        struct relighting_errors *ret, double *ret_light_db) {
    const int n = relighting->n_lights;
    g_autofree double *square = g_new(double, n), *of_ssim = g_new(double, n);
    g_autofree double *of_flip = g_new(double, n);
    struct comparing comparing = {relighting, pictures, predicted, square, of_ssim, of_flip};
    double sum = 0;
    work_for_each(0, n, compare_light, &comparing);
    *ret = (struct relighting_errors){0};
    for (int i = 0; i < n; i++) {
        sum += square[i] / n;
        ret->ssim += of_ssim[i] / n;
        ret->flip += of_flip[i] / n;
        if (ret_light_db)
            ret_light_db[i] = psnr_decibels(square[i]);
    }
    ret->psnr_db = psnr_decibels(sum);
}
