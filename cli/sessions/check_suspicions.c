/*
 * Finds mistakes in the input of a BTF or an MDF: it looks in the product for values that no
 * material has.
 *
 * Tones: the mean over texels of B(x, v, l) / cos θ_l is reciprocal. Let a and b be this mean for
 * two pairs of directions in which view and light are exchanged. Their asymmetry, over all such
 * pairs, is
 *   s = √(Σ (a − b)² / Σ ((a + b)/2)²).
 * Each possible mistake is undone, and s is compared with that of the values B:
 * - a wrong black level: B − p, with the p that minimises Σ (a − b)²,
 * - wrong tones: B^(1/2.2) and B^2.2, which are close to undoing sRGB in either direction.
 *
 * Only pairs with different polar angles show such a mistake.
 */
#include "check.h"

#include "base/direction.h"
#include "base/robust.h"
#include "btf/energy.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MIN_COS      0.05 /* minimum difference of cos θ within a pair */
#define MIN_PAIRS    6
#define MIN_SKEW     0.05 /* an asymmetry s below this counts as no mistake */
#define BETTER       4.0  /* undoing a mistake must lower the asymmetry by at least this factor */
#define DISPLAY      2.2
#define MAX_ALBEDO   1.05
#define USUAL_ALBEDO 0.7   /* albedo of a light material */
#define MIN_ALBEDO   0.002 /* even the blackest paints have a larger albedo */
#define MIN_SEEN     0.3
/* Maximum part of the texels that the laser shows above the reference plane. */
#define MAX_ABOVE 0.01
/* If the mean of a picture is below this part of the upper quartile of its view, the picture counts
 * as dark. */
#define DEAD 0.03
/* A view with fewer lights is not used for DEAD, because it has no quartile. */
#define MIN_LIGHTS 4
#define FEW_NAMES  4 /* maximum number of dark lights that are named */
#define ROWS       256

enum tone { AS_IS, ENCODED, DECODED, TONES };

/* Two pairs of directions in which view and light are exchanged. one and other are their indices in
 * views × lights. */
struct exchanged {
    int one, other;
    double cos_one, cos_other; /* cos θ of the light of each pair */
};

/* Adds a sentence, formatted as by printf(), to the list `to`. */
G_GNUC_PRINTF(2, 3)
static void suspect(GPtrArray *to, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_ptr_array_add(to, g_strdup_vprintf(format, arguments));
    va_end(arguments);
}

static double cos_deg(double deg) {
    return cos(deg * G_PI / 180);
}

/* Returns the pairs of directions in which view and light are exchanged, as struct exchanged. Only
 * pairs whose lights have different polar angles are included. */
static GArray *find_exchanged(const struct btf_layout *layout) {
    const int n_lights = (int)layout->lights.n, n = (int)layout->views.n * n_lights;
    g_autofree int *other = energy_exchanges(layout);
    GArray *pairs = g_array_new(FALSE, FALSE, sizeof(struct exchanged));
    for (int i = 0; i < n; i++) {
        const double cos_view = cos_deg((double)layout->views.theta_deg[i / n_lights]);
        const double cos_light = cos_deg((double)layout->lights.theta_deg[i % n_lights]);
        const struct exchanged pair = {i, other[i], cos_light, cos_view};
        if (other[i] > i && fabs(cos_view - cos_light) > MIN_COS)
            g_array_append_val(pairs, pair);
    }
    return pairs;
}

/* Returns means over texels of the luminance to the power of 1, 1/2.2 and 2.2. The array has TONES
 * × views × lights values. Returns NULL with an error on failure. */
static double *find_means(const struct btf_matrix *btf, GError **error) {
    static const double power[TONES] = {1, 1 / DISPLAY, DISPLAY};
    const gsize n_lights = btf->layout.lights.n, n = btf->layout.views.n * n_lights;
    const int n_texels = (int)btf_layout_texels(&btf->layout);
    g_autofree float *buffer = g_new(float, 3 * ROWS * n_lights);
    g_autofree double *means = g_new0(double, TONES *n);
    for (int first = 0; first < n_texels; first += ROWS)
        for (gsize view = 0; view < btf->layout.views.n; view++) {
            const int rows = MIN(ROWS, n_texels - first);
            gsize stride = 0;
            const float *from =
                btf_matrix_rows(btf, (int)view, first, rows, buffer, &stride, error);
            if (!from)
                return NULL;
            for (gsize i = 0; i < (gsize)rows * n_lights; i++) {
                const float *rgb = from + i / n_lights * stride + 3 * (i % n_lights);
                const double y = (double)rgb_luminance(rgb);
                for (int tone = 0; tone < TONES; tone++)
                    means[(gsize)tone * n + view * n_lights + i % n_lights] +=
                        pow(MAX(y, 0), power[tone]) / n_texels;
            }
        }
    return g_steal_pointer(&means);
}

/* Returns the asymmetry s of the values after `pedestal` is subtracted from each of them. */
static double asymmetry(const GArray *pairs, const double *values, double pedestal) {
    double differences = 0, squares = 0;
    for (guint i = 0; i < pairs->len; i++) {
        const struct exchanged *p = &g_array_index(pairs, struct exchanged, i);
        const double a = (values[p->one] - pedestal) / p->cos_one;
        const double b = (values[p->other] - pedestal) / p->cos_other;
        differences += (a - b) * (a - b);
        squares += (a + b) * (a + b) / 4;
    }
    return squares > 0 ? sqrt(differences / squares) : 0;
}

/* Returns the pedestal p that minimises Σ (a − b − p w)², which is p = Σ (a − b) w / Σ w². a and b
 * are the values of two pairs divided by cos θ_a and cos θ_b. θ_a and θ_b are the polar angles of
 * the lights of the two pairs, and w = 1/cos θ_a − 1/cos θ_b. */
static double best_pedestal(const GArray *pairs, const double *values) {
    double up = 0, down = 0;
    for (guint i = 0; i < pairs->len; i++) {
        const struct exchanged *p = &g_array_index(pairs, struct exchanged, i);
        const double w = 1 / p->cos_one - 1 / p->cos_other;
        up += (values[p->one] / p->cos_one - values[p->other] / p->cos_other) * w;
        down += w * w;
    }
    return down > 0 ? up / down : 0;
}

static void suspect_tones(const GArray *pairs, const double *means, gsize n, GPtrArray *ret) {
    const double p = best_pedestal(pairs, means), is = asymmetry(pairs, means, 0);
    const double flat = asymmetry(pairs, means, p),
                 encoded = asymmetry(pairs, means + ENCODED * n, 0),
                 decoded = asymmetry(pairs, means + DECODED * n, 0);
    const double least = MIN(flat, MIN(encoded, decoded));
    if (pairs->len < MIN_PAIRS || is < MIN_SKEW || least > is / BETTER)
        return;
    if (least == flat && p > 0)
        suspect(
            ret,
            "a level of %.3g of white is added to all values: without it the asymmetry is %.2g %% "
            "instead of %.2g %%. Subtract the black level of the cameras from the pictures, or "
            "keep other light out",
            p, 100 * flat, 100 * is);
    else if (least == flat)
        suspect(ret,
                "%.3g of white was subtracted from all values: with it added back, the asymmetry "
                "is %.2g %% instead of %.2g %%. Subtract a lower black level from the pictures",
                -p, 100 * flat, 100 * is);
    else if (least == encoded)
        suspect(ret,
                "the values look as if linear pictures had been taken for sRGB: raised to the "
                "power of 1/%g, they have an asymmetry of %.2g %% instead of %.2g %%. Pictures of "
                "8 bits are taken for sRGB. Give linear pictures as 16-bit PNG or TIFF, or as EXR",
                DISPLAY, 100 * encoded, 100 * is);
    else
        suspect(
            ret,
            "the values look as if sRGB pictures had been taken for linear: to the power of %g "
            "the asymmetry is %.2g %% instead of %.2g %%. Pictures of 16 bits and EXR are taken "
            "for linear. Give sRGB pictures with 8 bits, or switch off the gamma of the cameras",
            DISPLAY, 100 * decoded, 100 * is);
}

/* Finds lights that are dark in all views. A light is dark in a view if the mean over texels of
 * B(v, l) / cos θ_l is below DEAD times the upper quartile of this mean over all lights of the
 * view. With the upper quartile, up to half of the lamps may be dead. Each view has its own
 * quartile, because a glossy dark material is dark except under the lights that it mirrors.
 *
 * Does nothing if an import has already reported dark pictures. */
static void suspect_dead_lights(const struct btf_layout *layout, const double *means,
                                GPtrArray *ret) {
    const gsize n_lights = layout->lights.n;
    g_autofree gboolean *dark = g_new0(gboolean, n_lights + 1);
    g_autofree double *f = g_new(double, n_lights + 1), *sorted = g_new(double, n_lights + 1);
    int n_views = 0, n_dark = 0;
    for (guint i = 0; i < ret->len; i++)
        if (strstr(ret->pdata[i], "lights are dark"))
            return;
    for (gsize view = 0; view < layout->views.n; view++) {
        int n = 0;
        for (gsize l = 0; l < n_lights; l++) {
            const double cosine = cos_deg((double)layout->lights.theta_deg[l]);
            f[l] = cosine > MIN_COS ? means[view * n_lights + l] / cosine : NAN;
            if (isfinite(f[l]))
                sorted[n++] = f[l];
        }
        qsort(sorted, (gsize)n, sizeof *sorted, robust_by_value);
        const double usual = n >= MIN_LIGHTS ? sorted[3 * n / 4] : 0;
        if (!(usual > 0))
            continue;
        for (gsize l = 0; l < n_lights; l++)
            dark[l] = f[l] < DEAD * usual && (n_views == 0 || dark[l]);
        n_views++;
    }
    g_autoptr(GString) names = g_string_new(NULL);
    for (gsize l = 0; l < n_lights; l++) {
        if (!dark[l] || ++n_dark > FEW_NAMES)
            continue;
        g_string_append_printf(names, "%s%.3g° %.3g°", n_dark > 1 ? ", " : "",
                               (double)layout->lights.theta_deg[l],
                               (double)layout->lights.phi_deg[l]);
    }
    if (n_dark > FEW_NAMES)
        g_string_append_printf(names, " and %d more", n_dark - FEW_NAMES);
    if (n_dark > 0)
        suspect(
            ret,
            "%d of %d lights %s near zero in all views (θ φ %s), below %.0f %% of the other "
            "lights: did a lamp not shine? Capture these pictures again, or import without them",
            n_dark, (int)n_lights, n_dark == 1 ? "is" : "are", names->str, 100 * DEAD);
}

gboolean check_suspect_btf(const struct btf_matrix *btf, const struct energy *energy,
                           GPtrArray *ret, GError **error) {
    g_autoptr(GArray) pairs = find_exchanged(&btf->layout);
    g_autofree double *means = find_means(btf, error);
    const guint before = ret->len;
    if (!means)
        return FALSE;
    suspect_tones(pairs, means, btf->layout.views.n * btf->layout.lights.n, ret);
    if (ret->len == before)
        suspect_dead_lights(&btf->layout, means, ret);
    /* the energies are not checked, because wrong tones and dark pictures make them wrong */
    if (ret->len > before)
        return TRUE;
    if (energy->largest_albedo > MAX_ALBEDO)
        suspect(ret,
                "%.3g times a light's energy is reflected: is response in the rig file missing or "
                "too small (%.3g times as large gives %.1f), is the white tile darker than "
                "--reflectance said, or is an exposure time too short (another unit)?",
                energy->largest_albedo, energy->largest_albedo / USUAL_ALBEDO, USUAL_ALBEDO);
    else if (energy->largest_albedo < MIN_ALBEDO)
        suspect(
            ret,
            "only %.2g of a light's energy is reflected, less than from the blackest paint: is an "
            "exposure time too long (another unit), or was a picture taken without light?",
            energy->largest_albedo);
    return TRUE;
}

void check_suspect_mdf(const struct mdf_views_sums *mdf, const struct session_grid *grid,
                       GPtrArray *ret) {
    if (mdf->above > MAX_ABOVE * (double)mdf->texels)
        suspect(
            ret,
            "the laser shows %.1f %% of the surface above the reference plane at reference_mm = "
            "%g, and it is not measured there. The plane must touch the highest points. Give a "
            "higher one (reference_mm in [sample] of the session file, --reference of mesorig "
            "import poses)",
            100.0 * (double)mdf->above / (double)mdf->texels, grid->reference_mm);
    else if (mdf->texels > 0 && mdf->seen < MIN_SEEN * mdf->texels)
        suspect(
            ret,
            "only %.0f %% of the surface is seen, and points far below depth_mm = %g are left out: "
            "is the structure deeper? Give its depth (depth_mm in [sample] of the session file, "
            "--depth of mesorig import poses) and its reference plane",
            100.0 * (double)mdf->seen / (double)mdf->texels, grid->depth_mm);
}
