#include "fit_normals.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/direction.h"
#include "base/vec.h"
#include "btf/btf_layout.h"
#include "codecs/codec/texel_model.h"
#include "codecs/hsh/hsh.h"
#include "codecs/lobes/lobes.h"
#include "exr/exr.h"
#include "integrate_normals.h"
#include "session/session.h"

#define LIGHTS 128
/* minimum z of the lights under which the fit is evaluated; fits are least certain under lower
 * lights */
#define MIN_Z 0.15
#define FACES 0.15 /* minimum cosine between normal and light of a light that counts */
/* largest difference |f(l) − b·l| of a light that counts, relative to |b| */
#define TOLERANCE 0.1
#define ROUNDS    8
/* a texel is shadowed if more than this share of the lights that it faces is left out */
#define SHADOWED    0.25
#define PTM_TERMS   6
#define PTM_COLOURS 3 /* number of values of a texel before C0 */

struct fit {
    struct lobes *ptm;
    struct hsh *hsh;
    const struct btf_layout *layout;
    gsize slice; /* the view nearest to the normal */
    int n_terms;
    enum fit_normals_method method;
    struct vec3 lights[LIGHTS];
    float basis[LIGHTS][HSH_MAX_TERMS];
    float *normals; /* texels × 3; all 0 if a texel has none */
    guint8 *clipped, *shadowed;
};

gboolean fit_normals_applies(const char *path) {
    g_autofree char *mdf = g_build_filename(path, "products", "mdf.exr", NULL);
    g_autofree char *ptm = g_build_filename(path, "products", "ptm.exr", NULL);
    g_autofree char *hsh = g_build_filename(path, "products", "hsh.exr", NULL);
    return g_file_test(path, G_FILE_TEST_IS_REGULAR) ||
           (!g_file_test(mdf, G_FILE_TEST_EXISTS) &&
            (g_file_test(ptm, G_FILE_TEST_EXISTS) || g_file_test(hsh, G_FILE_TEST_EXISTS)));
}

static gboolean fit_normals_open(struct fit *fit, const char *path, GError **error) {
    g_autofree char *file = g_strdup(path), *kind = NULL;
    if (g_file_test(path, G_FILE_TEST_IS_DIR)) {
        g_free(file);
        file = g_build_filename(path, "products", "ptm.exr", NULL);
        if (!g_file_test(file, G_FILE_TEST_EXISTS)) {
            g_free(file);
            file = g_build_filename(path, "products", "hsh.exr", NULL);
        }
    }
    if (!session_check_product(file, error))
        return FALSE;
    g_autoptr(ExrFile) headers = exr_read_headers(file, error);
    if (!headers)
        return FALSE;
    kind = g_strdup(texel_model_kind(headers));
    if (g_strcmp0(kind, "ptm") == 0) {
        fit->ptm = lobes_read(file, error);
        fit->layout = fit->ptm ? &fit->ptm->layout : NULL;
        fit->n_terms = PTM_TERMS;
    } else if (g_strcmp0(kind, "hsh") == 0) {
        fit->hsh = hsh_read(file, error);
        fit->layout = fit->hsh ? &fit->hsh->layout : NULL;
        fit->n_terms = fit->hsh ? fit->hsh->n_terms : 0;
    } else {
        return data_error_fail(file, 0, error,
                               "the file is of kind %s, but normals need a ptm or an hsh; make one "
                               "with “mesorig compress --method ptm”",
                               kind ? kind : "none");
    }
    return fit->layout &&
           (fit->ptm || fit->method != FIT_NORMALS_MAXIMUM ||
            data_error_fail(
                file, 0, error,
                "an hsh has no polynomial with a maximum; leave out --maximum, or make a ptm"));
}

/* Chooses the view nearest to the normal, and places LIGHTS lights on Fibonacci's spiral over the
 * cap above the lowest measured light, each with an equal area. */
static void choose_lights(struct fit *fit) {
    const struct direction_list *views = &fit->layout->views;
    g_autofree float *lights = direction_list_vectors(&fit->layout->lights);
    double lowest = 1;
    for (gsize i = 0; i < fit->layout->lights.n; i++)
        lowest = MIN(lowest, (double)lights[3 * i + 2]);
    lowest = CLAMP(lowest, MIN_Z, 0.9);
    for (gsize i = 1; i < views->n; i++)
        if (views->theta_deg[i] < views->theta_deg[fit->slice])
            fit->slice = i;
    for (int i = 0; i < LIGHTS; i++) {
        const double z = 1 - (i + 0.5) / LIGHTS * (1 - lowest), r = sqrt(1 - z * z);
        const double phi = i * G_PI * (1 + sqrt(5));
        const float l[3] = {(float)(r * cos(phi)), (float)(r * sin(phi)), (float)z};
        const float ptm[PTM_TERMS] = {l[0] * l[0], l[1] * l[1], l[0] * l[1], l[0], l[1], 1};
        fit->lights[i] = vec3(l[0], l[1], l[2]);
        if (fit->ptm)
            memcpy(fit->basis[i], ptm, sizeof ptm);
        else
            hsh_basis(l, fit->n_terms, fit->basis[i]);
    }
}

/* Gives the coefficients of luminance. Those of a PTM are without the colour of the texel, which
 * does not change the normal. */
static void coefficients(const struct fit *fit, gsize texel, double *ret) {
    const gsize at = fit->slice * btf_layout_texels(fit->layout) + texel;
    for (int k = 0; k < fit->n_terms; k++)
        ret[k] =
            fit->ptm
                ? (double)fit->ptm->values[at * (gsize)fit->ptm->n_values + PTM_COLOURS + (gsize)k]
                : (double)rgb_luminance(fit->hsh->values +
                                        (at * (gsize)fit->n_terms + (gsize)k) * 3);
}

static struct vec3 maximum(const double *c, gboolean *ret_clipped) {
    const double curvature = 4 * c[0] * c[1] - c[2] * c[2];
    const double x = (c[2] * c[4] - 2 * c[1] * c[3]) / curvature;
    const double y = (c[2] * c[3] - 2 * c[0] * c[4]) / curvature;
    *ret_clipped = !(curvature > 0 && c[0] < 0 && x * x + y * y < 1);
    return *ret_clipped ? vec3(0, 0, 0) : vec3(x, y, sqrt(1 - x * x - y * y));
}

/* Finds b of min Σ (f − b·l)² over the lights that count, by Cramer's rule. Returns 0 if these
 * lights do not determine b. */
static struct vec3 least_squares(const struct fit *fit, const double *f, const gboolean *counts) {
    struct vec3 x = vec3(0, 0, 0), y = x, z = x, sum = x; /* columns of Σ l lᵀ, and Σ f l */
    for (int i = 0; i < LIGHTS; i++)
        if (counts[i]) {
            const struct vec3 l = fit->lights[i];
            x = vec3_add(x, vec3_scale(l, l.x));
            y = vec3_add(y, vec3_scale(l, l.y));
            z = vec3_add(z, vec3_scale(l, l.z));
            sum = vec3_add(sum, vec3_scale(l, f[i]));
        }
    const double volume = vec3_dot(x, vec3_cross(y, z));
    if (!(volume > 1e-6))
        return vec3(0, 0, 0);
    return vec3_scale(vec3(vec3_dot(sum, vec3_cross(y, z)), vec3_dot(x, vec3_cross(sum, z)),
                           vec3_dot(x, vec3_cross(y, sum))),
                      1 / volume);
}

/* Finds the normal by Lambert's law (fit_normals.h). Begins with all lights, including dark ones,
 * and repeats the fit with the lights that count. Returns 0 if there is no normal. */
static struct vec3 lambert(const struct fit *fit, const double *c, gboolean *ret_shadowed) {
    double f[LIGHTS];
    gboolean counts[LIGHTS];
    int facing = 0, left_out = 0;
    for (int i = 0; i < LIGHTS; i++) {
        f[i] = 0;
        for (int k = 0; k < fit->n_terms; k++)
            f[i] += c[k] * (double)fit->basis[i][k];
        f[i] = MAX(f[i], 0);
        counts[i] = TRUE;
    }
    struct vec3 b = least_squares(fit, f, counts);
    for (int round = 0; round < ROUNDS; round++) {
        const double length = vec3_length(b);
        facing = left_out = 0;
        if (!(length > 0) || !isfinite(length))
            return vec3(0, 0, 0);
        for (int i = 0; i < LIGHTS; i++) {
            const double expected = vec3_dot(b, fit->lights[i]);
            const gboolean faces = expected > FACES * length;
            /* The first rounds are too inaccurate to detect shadows. */
            counts[i] = faces && (round < 2 || fabs(f[i] - expected) < TOLERANCE * length);
            facing += faces;
            left_out += faces && !counts[i];
        }
        const struct vec3 next = least_squares(fit, f, counts);
        if (!(vec3_length(next) > 0))
            break; /* too few lights are left: keeps the previous result */
        b = next;
    }
    *ret_shadowed = left_out > SHADOWED * facing;
    b = vec3_unit(b);
    return b.z > 0 ? b : vec3(0, 0, 0);
}

static void fit_normals_row(int row, gpointer data) {
    struct fit *fit = data;
    const gsize width = fit->layout->width;
    for (gsize texel = (gsize)row * width; texel < ((gsize)row + 1) * width; texel++) {
        double c[HSH_MAX_TERMS] = {0};
        gboolean clipped = FALSE, shadowed = FALSE;
        coefficients(fit, texel, c);
        const struct vec3 n =
            fit->method == FIT_NORMALS_MAXIMUM ? maximum(c, &clipped) : lambert(fit, c, &shadowed);
        fit->normals[3 * texel] = (float)n.x;
        fit->normals[3 * texel + 1] = (float)n.y;
        fit->normals[3 * texel + 2] = (float)n.z;
        fit->clipped[texel] = clipped;
        fit->shadowed[texel] = shadowed;
    }
}

static struct exr_part *fit_normals_part(const struct fit *fit, gboolean heights) {
    static const char *const nz[] = {"N", "Z", NULL}, *const xyz[] = {"X", "Y", "Z", NULL};
    const gsize n = btf_layout_texels(fit->layout);
    const int width = (int)fit->layout->width, height = (int)fit->layout->height;
    struct exr_part *part =
        exr_part_new(heights ? "height" : "normals", width, height, heights ? nz : xyz, EXR_FLOAT);
    if (!heights) {
        for (gsize i = 0; i < 3 * n; i++)
            part->planes[i % 3][i / 3] = fit->normals[i];
        return part;
    }
    integrate_normals_of(fit->normals, width, height, fit->layout->texel_mm, part->planes[1],
                         part->planes[0]);
    return part;
}

static gboolean fit_normals_write(const struct fit *fit, const char *path, const char *file,
                                  gboolean heights, struct fit_normals_result *ret,
                                  GError **error) {
    const gsize n = btf_layout_texels(fit->layout);
    ret->model = fit->ptm ? "ptm" : "hsh";
    ret->texels = (int)n;
    for (gsize i = 0; i < n; i++) {
        ret->clipped += fit->clipped[i];
        ret->shadowed += fit->shadowed[i];
        ret->holes += fit->normals[3 * i + 2] <= 0;
    }
    if (ret->holes == ret->texels)
        return data_error_fail(path, 0, error, "no texel of the %s has a normal, because %s",
                               ret->model,
                               fit->method == FIT_NORMALS_MAXIMUM
                                   ? "no polynomial has its maximum above the sample; check the "
                                     "pictures, or leave out --maximum"
                                   : "all texels are black or brightest from below; check the "
                                     "pictures and the directions of the lights");
    struct exr_part *part = fit_normals_part(fit, heights);
    g_autoptr(ExrFile) exr = exr_file_new();
    exr_file_add(exr, part);
    exr_set_string(part, "mesorig.kind", heights ? "height" : "normals");
    exr_set_string(part, "mesorig.model", ret->model);
    exr_set_double(part, "texel_mm", fit->layout->texel_mm);
    exr_set_double(part, "reference_mm", fit->layout->reference_mm);
    exr_set_int(part, "holes", ret->holes);
    exr_set_int(part, "clipped", ret->clipped);
    exr_set_int(part, "shadowed", ret->shadowed);
    return exr_write(file, exr, EXR_ZIP, TRUE, error);
}

gboolean fit_normals(const char *path, const char *file, gboolean heights,
                     enum fit_normals_method method, const struct work *work,
                     struct fit_normals_result *ret, GError **error) {
    struct fit fit = {.method = method};
    gboolean ok = fit_normals_open(&fit, path, error);
    *ret = (struct fit_normals_result){0};
    if (ok) {
        const gsize n = btf_layout_texels(fit.layout);
        choose_lights(&fit);
        fit.normals = g_new0(float, 3 * n);
        fit.clipped = g_new0(guint8, n);
        fit.shadowed = g_new0(guint8, n);
        ok =
            work_parallel(work, "normals", (int)fit.layout->height, fit_normals_row, &fit, error) &&
            fit_normals_write(&fit, path, file, heights, ret, error);
    }
    g_free(fit.normals);
    g_free(fit.clipped);
    g_free(fit.shadowed);
    lobes_free(fit.ptm);
    hsh_free(fit.hsh);
    return ok;
}
