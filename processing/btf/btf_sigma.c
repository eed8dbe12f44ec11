/* Computes the variances of pixels from the exposures of their picture, and the channel "sigma"
 * from the variances of texels. */
#include "btf_sigma.h"

#include <math.h>
#include <stdlib.h>

#include "base/data_error.h"
#include "base/robust.h"

#define SIGNIFICANT_BITS 5     /* significant bits of a stored σ */
#define SAME_DEG         0.001 /* polar angles that differ by less, in degrees, count as the same */

gboolean btf_exposures_read(const struct exr_part *frame, const char *path,
                            struct btf_exposures *ret, GError **error) {
    const char *text = NULL;
    double shorter = 0;
    *ret = (struct btf_exposures){0};
    if (!exr_get_string(frame, "mesorig.exposures_us", &text, NULL))
        return TRUE;
    g_auto(GStrv) items = g_strsplit(text, ";", -1);
    const guint n = g_strv_length(items);
    for (guint i = 0; i < n; i++) {
        char *end = NULL;
        const double ms = g_ascii_strtod(items[i], &end) * 1e-3;
        if (n <= BTF_SIGMA_EXPOSURES && end != items[i] && *end == '\0' && isfinite(ms) &&
            ms > (i > 0 ? ret->ms[i - 1] : 0)) {
            ret->ms[i] = ms;
            continue;
        }
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INVALID,
            "%s: mesorig.exposures_us is “%s”, but must be 1 to %d exposure times in rising "
            "order with “;” between them; capture or import this shot again",
            path, text, BTF_SIGMA_EXPOSURES);
        return FALSE;
    }
    ret->n = (int)n;
    if (exr_get_double(frame, "mesorig.shorter_from", &shorter, NULL) && shorter > 0)
        ret->shorter = (float)shorter;
    return TRUE;
}

/* A pixel's value m was merged from the shortest exposure and from each longer exposure t_i in
 * which it is not saturated, that is, m < shorter · t_n / t_i. t_n is the longest exposure. The
 * variance from rounding m to a half float, (m · 2⁻¹¹)² / 3, is added to the variance of the
 * noise. */
void btf_sigma_pixels(const struct transfer *transfer, const struct btf_exposures *exposures,
                      const float *values, gsize n, float *ret_variances) {
    float slope[BTF_SIGMA_EXPOSURES] = {0}, floor[BTF_SIGMA_EXPOSURES] = {0},
          from[BTF_SIGMA_EXPOSURES] = {0};
    double sum_ms = 0;
    for (int i = 0; i < exposures->n; i++) {
        double a, b;
        sum_ms += exposures->ms[i];
        transfer_noise(transfer, sum_ms, i + 1, &a, &b);
        floor[i] = (float)a;
        slope[i] = (float)b;
        from[i] =
            i == 0 || exposures->shorter <= 0
                ? INFINITY
                : (float)(exposures->shorter * exposures->ms[exposures->n - 1] / exposures->ms[i]);
    }
    for (gsize k = 0; k < n; k++) {
        const float value = isfinite(values[k]) ? MAX(values[k], 0) : 0;
        const float rounding = value * (float)(1.0 / 2048);
        int used = exposures->n - 1;
        while (used > 0 && used < BTF_SIGMA_EXPOSURES && value >= from[used])
            used--;
        ret_variances[k] = floor[used] + slope[used] * value + rounding * rounding / 3;
    }
}

/* Returns the median (the upper one if n is even), and reorders the values. Returns 0 if n is 0. */
static double btf_sigma_median(double *values, gsize n) {
    return n > 0 ? robust_select(values, (int)n, (int)(n / 2)) : 0;
}

/* Computes sigma(x)² = ⅓ Σ_c σ_c(x)² / f_c² with f_c² = Σ_x σ_c(x)² / (⅓ Σ_x,c σ_c(x)²). Sums over
 * texels x leave out holes. */
void btf_sigma_fill(struct exr_part *part, const float *variances, const guint8 *holes) {
    const gsize n = (gsize)part->width * (gsize)part->height;
    float *sigma = exr_part_plane(part, "sigma");
    const float *const rho[] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                                exr_part_plane(part, "B")};
    g_autofree double *all = g_new(double, n), *relative = g_new(double, n);
    double sums[3] = {0}, f[3], squares = 0;
    gsize seen = 0;
    for (gsize i = 0; i < n; i++)
        for (gsize c = 0; c < 3 && !holes[i]; c++)
            sums[c] += (double)variances[3 * i + c];
    const double mean = (sums[0] + sums[1] + sums[2]) / 3;
    for (gsize c = 0; c < 3; c++)
        f[c] = mean > 0 && sums[c] > 0 ? sqrt(sums[c] / mean) : 1;
    for (gsize i = 0; i < n; i++) {
        double square = 0, value = 0;
        for (gsize c = 0; c < 3; c++) {
            square += (double)variances[3 * i + c] / (3 * f[c] * f[c]);
            value += (double)(rho[c][i] * rho[c][i]) / 3;
        }
        int exponent;
        const double digits = frexp(sqrt(square), &exponent);
        sigma[i] = holes[i] ? 0
                            : (float)ldexp(round(ldexp(digits, SIGNIFICANT_BITS)),
                                           exponent - SIGNIFICANT_BITS);
        if (holes[i])
            continue;
        all[seen] = (double)sigma[i];
        squares += value;
        relative[seen++] = (double)(sigma[i] / (float)fmax(sqrt(value), BTF_SIGMA_DARK));
    }
    exr_set_v3d(part, "sigma.colour", f[0], f[1], f[2]);
    exr_set_double(part, "sigma.rms", seen > 0 ? sqrt(mean / (double)seen) : 0);
    exr_set_double(part, "sigma.value", seen > 0 ? sqrt(squares / (double)seen) : 0);
    exr_set_double(part, "sigma.median", btf_sigma_median(all, seen));
    exr_set_double(part, "sigma.relative", btf_sigma_median(relative, seen));
}

/* ρ_c ∝ 1 / (response · camera colour_c · intensity · output · lamp colour_c). The relative
 * variances of the factors are added. The output has two errors: the lamp's output differs from
 * shot to shot, and between the pictures of the cameras in a shot. */
void btf_sigma_scale(const struct radiometry_camera *camera, const struct radiometry_lamp *lamp,
                     double output_error, double ret[3]) {
    const double output =
        !lamp || !lamp->known
            ? 0
            : hypot(output_error > 0 ? output_error : lamp->flicker, lamp->frame_flicker);
    for (int c = 0; c < 3; c++) {
        double square = output * output;
        if (camera && camera->known)
            square += pow(camera->response_error, 2) +
                      pow(camera->colour_error[c] / camera->colour[c], 2);
        if (lamp && lamp->known)
            square +=
                pow(lamp->intensity_error, 2) + pow(lamp->colour_error[c] / lamp->colour[c], 2);
        ret[c] = sqrt(square);
    }
}

gboolean btf_sigma_read(const struct exr_part *part, struct btf_sigma *ret) {
    return exr_get_v3d(part, "sigma.colour", ret->colour, NULL) &&
           exr_get_v3d(part, "sigma.scale", ret->scale, NULL) &&
           exr_get_double(part, "sigma.rms", &ret->rms, NULL) &&
           exr_get_double(part, "sigma.value", &ret->value, NULL) &&
           exr_get_double(part, "sigma.median", &ret->median, NULL) &&
           exr_get_double(part, "sigma.relative", &ret->relative, NULL);
}

/* sigma.relative of a captured picture, and its directions */
struct captured {
    double relative, view_theta_deg, view_phi_deg, light_theta_deg, light_phi_deg;
};

static gboolean same_angles(const struct captured *a, const struct captured *b) {
    return fabs(a->view_theta_deg - b->view_theta_deg) < SAME_DEG &&
           fabs(a->light_theta_deg - b->light_theta_deg) < SAME_DEG;
}

static int by_angles(gconstpointer one, gconstpointer other) {
    const struct captured *a = one, *b = other;
    if (same_angles(a, b))
        return 0;
    if (fabs(a->view_theta_deg - b->view_theta_deg) >= SAME_DEG)
        return a->view_theta_deg < b->view_theta_deg ? -1 : 1;
    return a->light_theta_deg < b->light_theta_deg ? -1 : 1;
}

/* Finds the pictures that are worse than others at the same polar angles. Other polar angles are no
 * comparison, because a grazing view or light has larger errors in every session. */
static void find_worse(GArray *pictures, struct btf_sigma_sums *ret) {
    g_autofree double *values = g_new(double, pictures->len + 1);
    const struct captured *all = (const struct captured *)(const void *)pictures->data;
    double farthest = 0;
    for (guint i = 0; i < pictures->len; i++)
        values[i] = all[i].relative;
    const double usual = btf_sigma_median(values, pictures->len);
    g_array_sort(pictures, by_angles);
    for (guint first = 0, end = 0; first < pictures->len; first = end) {
        for (end = first; end < pictures->len && same_angles(&all[first], &all[end]); end++)
            values[end - first] = all[end].relative;
        const double of_ring =
            end - first < BTF_SIGMA_RING ? usual : btf_sigma_median(values, end - first);
        for (guint i = first; i < end; i++) {
            const double relative = all[i].relative;
            if (relative <= BTF_SIGMA_LARGE || relative <= 2 * of_ring)
                continue;
            ret->worse++;
            if (relative <= farthest * of_ring)
                continue;
            farthest = relative / of_ring;
            ret->worse_relative = relative;
            ret->worse_view_theta_deg = all[i].view_theta_deg;
            ret->worse_view_phi_deg = all[i].view_phi_deg;
            ret->worse_light_theta_deg = all[i].light_theta_deg;
            ret->worse_light_phi_deg = all[i].light_phi_deg;
        }
    }
}

void btf_sigma_sum(const char *directory, struct btf_sigma_sums *ret) {
    g_autofree char *folder = g_build_filename(directory, "products", "btf", NULL);
    g_autoptr(GDir) names = g_dir_open(folder, 0, NULL);
    g_autoptr(GArray) medians = g_array_new(FALSE, FALSE, sizeof(double));
    g_autoptr(GArray) relatives = g_array_new(FALSE, FALSE, sizeof(double));
    g_autoptr(GArray) pictures = g_array_new(FALSE, FALSE, sizeof(struct captured));
    double errors = 0, values = 0;
    const char *name;
    *ret = (struct btf_sigma_sums){0};
    while (names && (name = g_dir_read_name(names))) {
        g_autofree char *path = g_build_filename(folder, name, NULL);
        g_autoptr(ExrFile) file =
            g_str_has_suffix(name, ".exr") ? exr_read_headers(path, NULL) : NULL;
        for (guint k = 0; file && k < file->parts->len; k++) {
            const struct exr_part *part = g_ptr_array_index(file->parts, k);
            struct btf_sigma sigma;
            ret->lights++;
            if (!btf_sigma_read(part, &sigma))
                continue;
            g_array_append_val(medians, sigma.median);
            g_array_append_val(relatives, sigma.relative);
            ret->known++;
            errors += sigma.rms * sigma.rms;
            values += sigma.value * sigma.value;
            ret->large += sigma.relative > BTF_SIGMA_LARGE;
            ret->worst = fmax(ret->worst, sigma.relative);
            int predicted;
            struct captured picture = {.relative = sigma.relative};
            if ((exr_get_int(part, "mesorig.predicted", &predicted, NULL) && predicted > 0) ||
                !exr_get_double(part, "view.theta_deg", &picture.view_theta_deg, NULL) ||
                !exr_get_double(part, "view.phi_deg", &picture.view_phi_deg, NULL) ||
                !exr_get_double(part, "light.theta_deg", &picture.light_theta_deg, NULL) ||
                !exr_get_double(part, "light.phi_deg", &picture.light_phi_deg, NULL))
                continue;
            g_array_append_val(pictures, picture);
        }
    }
    ret->median = btf_sigma_median((double *)(void *)medians->data, medians->len);
    ret->relative = btf_sigma_median((double *)(void *)relatives->data, relatives->len);
    find_worse(pictures, ret);
    ret->share = values > 0 ? errors / values : 0;
}
