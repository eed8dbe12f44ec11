/*
 * Repeats what Meseth et al. 2003 found about BTFs with sessions of Mesorig: how much the energy of
 * views and of lights changes from one direction to the next (fig. 3), whether functions fit
 * reflectance fields or light fields better (§4), how much of a fit is left under a light at the
 * horizon (fig. 4), and spherical plots of a texel next to its fits (figs 1, 5).
 */
#include "base/direction.h"
#include "base/vec.h"
#include "bench.h"
#include "codecs/lobes/lobes_private.h"
#include "directions/directions.h"
#include "lib/btf_fixture.h"

#include <cairo.h>
#include <math.h>
#include <stdlib.h>

#define MIN_COSINE 0.05 /* as in energy.c */
#define PANEL      320  /* pixels */
#define RINGS      18   /* of a plot, of 5 degrees */
#define AROUND     36

static struct vec3 fields_direction(const struct direction_list *list, gsize i) {
    float d[3];
    direction_from_deg(list->theta_deg[i], list->phi_deg[i], d);
    return vec3((double)d[0], (double)d[1], (double)d[2]);
}

/* The next direction of the same ring; −1 where it is alone on it. */
static int fields_neighbour(const struct direction_list *list, gsize i) {
    float least = 1e9F;
    int best = -1;
    for (gsize j = 0; j < list->n; j++) {
        float turn = fmodf(list->phi_deg[j] - list->phi_deg[i] + 720, 360);
        if (fabsf(list->theta_deg[j] - list->theta_deg[i]) < 1 && turn > 1e-3F && turn < least) {
            least = turn;
            best = (int)j;
        }
    }
    return best;
}

/* Luminance over cos θ_l: n_views × n_lights; 0 where the cosine is too small to divide by. */
static void fields_reflectance(const struct btf_matrix *btf, gsize texel, double *ret) {
    const gsize n_lights = btf->layout.lights.n, n = btf->layout.views.n * n_lights;
    for (gsize i = 0; i < n; i++) {
        const double cosine = fields_direction(&btf->layout.lights, i % n_lights).z;
        const float *rgb = btf->values + 3 * (texel * n + i);
        ret[i] = cosine > MIN_COSINE ? (double)rgb_luminance(rgb) / cosine : 0;
    }
}

/* Along each ring, relative to the mean of the series: RMS changes from a direction to the next,
 * and RMS differences from the mean of both neighbours, which a smooth series has hardly any of. */
struct steps {
    double all, kinks;
    double lowest, lowest_kinks; /* those of the lowest ring only */
    double theta_deg;            /* of the lowest ring */
    int around;                  /* directions on it */
};

/* series: of each texel, n_texels × list->n. */
static struct steps fields_steps(const struct direction_list *list, const double *series,
                                 gsize n_texels) {
    struct steps ret = {0};
    double sum[2] = {0}, steps[2] = {0}, kinks[2] = {0}; /* of all rings, of the lowest */
    gsize n[2] = {0};
    g_autofree int *next = g_new(int, list->n);
    for (gsize i = 0; i < list->n; i++) {
        next[i] = fields_neighbour(list, i);
        ret.theta_deg = MAX(ret.theta_deg, (double)list->theta_deg[i]);
    }
    for (gsize texel = 0; texel < n_texels; texel++)
        for (gsize i = 0; i < list->n; i++) {
            const double *row = series + texel * list->n;
            const int rings = (double)list->theta_deg[i] > ret.theta_deg - 1 ? 2 : 1;
            if (next[i] < 0)
                continue;
            const double at = row[next[i]], after = row[next[next[i]]];
            for (int ring = 0; ring < rings; ring++) {
                sum[ring] += at;
                steps[ring] += (at - row[i]) * (at - row[i]);
                kinks[ring] += pow(at - 0.5 * (row[i] + after), 2);
                n[ring]++;
            }
        }
    ret.all = sqrt(steps[0] * (double)n[0]) / sum[0];
    ret.kinks = sqrt(kinks[0] * (double)n[0]) / sum[0];
    ret.lowest = sqrt(steps[1] * (double)n[1]) / sum[1];
    ret.lowest_kinks = sqrt(kinks[1] * (double)n[1]) / sum[1];
    ret.around = (int)(n[1] / n_texels);
    return ret;
}

static void fields_print_steps(const struct btf_matrix *btf) {
    const gsize n_texels = btf_layout_texels(&btf->layout);
    const gsize n_views = btf->layout.views.n, n_lights = btf->layout.lights.n;
    g_autofree double *f = g_new0(double, n_views *n_lights);
    g_autofree double *e_r = g_new0(double, n_texels *n_views);
    g_autofree double *e_i = g_new0(double, n_texels *n_lights);
    for (gsize texel = 0; texel < n_texels; texel++) {
        fields_reflectance(btf, texel, f);
        for (gsize v = 0; v < n_views; v++)
            for (gsize l = 0; l < n_lights; l++) {
                e_r[texel * n_views + v] += f[v * n_lights + l] / (double)n_lights;
                e_i[texel * n_lights + l] += f[v * n_lights + l] / (double)n_views;
            }
    }
    const struct steps r = fields_steps(&btf->layout.views, e_r, n_texels);
    const struct steps i = fields_steps(&btf->layout.lights, e_i, n_texels);
    bench_put("%.5f{e_r_steps} %.5f{e_i_steps} %.5f{e_r_lowest_steps} %.5f{e_i_lowest_steps} "
              "%.5f{e_r_kinks} %.5f{e_i_kinks} %.5f{e_r_lowest_kinks} %.5f{e_i_lowest_kinks} "
              "%g{lowest_view_deg} %d{views_on_it} %g{lowest_light_deg} %d{lights_on_it}",
              r.all, i.all, r.lowest, i.lowest, r.kinks, i.kinks, r.lowest_kinks, i.lowest_kinks,
              r.theta_deg, r.around, i.theta_deg, i.around);
}

/* Views and lights exchanged, so that a reflectance field of the result is a light field; divided:
 * values are without n·l. */
static struct btf_matrix *fields_other(const struct btf_matrix *btf, gboolean exchanged,
                                       gboolean divided) {
    const struct direction_list views = direction_list_copy(&btf->layout.views);
    const struct direction_list lights = direction_list_copy(&btf->layout.lights);
    const gsize n_views = views.n, n_lights = lights.n, n = n_views * n_lights;
    struct btf_matrix *ret =
        btf_fixture_of(btf->name, (int)btf->layout.width, (int)btf->layout.height,
                       exchanged ? lights : views, exchanged ? views : lights);
    for (gsize texel = 0; texel < btf_layout_texels(&btf->layout); texel++)
        for (gsize i = 0; i < n; i++) {
            const gsize v = i / n_lights, l = i % n_lights;
            const double cosine = fields_direction(&btf->layout.lights, l).z;
            const gsize to = exchanged ? l * n_views + v : i;
            const float factor = divided ? (float)(1 / MAX(cosine, MIN_COSINE)) : 1;
            for (gsize c = 0; c < 3; c++)
                ret->values[3 * (texel * n + to) + c] =
                    btf->values[3 * (texel * n + i) + c] * factor;
        }
    return ret;
}

static double fields_fit(const struct btf_matrix *btf, enum lobes_model model, gboolean exchanged,
                         gboolean divided) {
    const struct lobes_options options = {.model = model};
    struct btf_matrix *other = fields_other(btf, exchanged, divided);
    struct lobes *lobes = lobes_compute(other, &options, NULL);
    const double error = lobes->luminance_error;
    lobes_free(lobes);
    btf_matrix_free(other);
    return error;
}

static void fields_print_fits(const struct btf_matrix *btf) {
    static const enum lobes_model models[] = {LOBES_FIELDS, LOBES_PTM};
    for (gsize m = 0; m < G_N_ELEMENTS(models); m++)
        for (int divided = 0; divided < 2; divided++) {
            g_autofree char *name =
                g_strconcat(lobes_model_name(models[m]), divided ? "_without_nl" : "", NULL);
            bench_row(name, "%.5f{reflectance_fields} %.5f{light_fields}",
                      fields_fit(btf, models[m], FALSE, divided),
                      fields_fit(btf, models[m], TRUE, divided));
        }
}

static double fields_luminance(const struct lobes *lobes, int view, int texel, struct vec3 light) {
    const struct vec3 v = fields_direction(&lobes->layout.views, (gsize)view);
    const float to_view[3] = {(float)v.x, (float)v.y, (float)v.z};
    const float to_light[3] = {(float)light.x, (float)light.y, (float)light.z};
    float rgb[3];
    lobes_evaluate(lobes, lobes->n_slices > 1 ? view : 0, texel, to_view, to_light, rgb);
    return (double)rgb_luminance(rgb);
}

static struct vec3 fields_light(int ring, int around) {
    const double theta = ring * 0.5 * G_PI / RINGS, phi = 2 * G_PI * around / AROUND;
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

/* Mean size of what a model gives under lights at the horizon, where n·l is 0, over the mean of the
 * measured luminances. */
static double fields_horizon(const struct btf_matrix *btf, const struct lobes *lobes) {
    const gsize n = btf_layout_texels(&btf->layout) * btf->layout.views.n * btf->layout.lights.n;
    const int n_texels = (int)btf_layout_texels(&btf->layout), n_views = (int)btf->layout.views.n;
    double measured = 0, left = 0;
    for (gsize i = 0; i < n; i++)
        measured += (double)rgb_luminance(btf->values + 3 * i) / (double)n;
    for (int texel = 0; texel < n_texels; texel++)
        for (int view = 0; view < n_views; view++)
            for (int around = 0; around < AROUND; around++)
                left += fabs(fields_luminance(lobes, view, texel, fields_light(RINGS, around)));
    return left / ((double)n_texels * n_views * AROUND) / measured;
}

/* A spherical plot: the distance from the middle is the luminance under a light from there. */
struct plot {
    cairo_t *cr;
    double x, y, size; /* of the middle; pixels of a distance of 1 */
};

static void fields_point(const struct plot *plot, struct vec3 at, double ret[2]) {
    const double turn = 0.6, lift = 0.42;
    const double across = at.x * cos(turn) - at.y * sin(turn);
    const double into = at.x * sin(turn) + at.y * cos(turn);
    ret[0] = plot->x + plot->size * across;
    ret[1] = plot->y - plot->size * (at.z * cos(lift) + into * sin(lift));
}

static void fields_quad(const struct plot *plot, const double *radius, int ring, int around) {
    for (int corner = 0; corner < 4; corner++) {
        const int i = ring + corner / 2, k = around + (corner == 1 || corner == 2);
        double p[2];
        fields_point(plot, vec3_scale(fields_light(i, k), radius[i * AROUND + k % AROUND]), p);
        cairo_line_to(plot->cr, p[0], p[1]);
    }
    cairo_close_path(plot->cr);
}

/* From behind to the front, so that what is nearer covers what is not. */
static void fields_draw_solid(const struct plot *plot, const double *radius) {
    static const double behind =
        1.5 * G_PI - 0.6; /* azimuth that points away, see fields_point() */
    for (int step = 0; step < AROUND; step++) {
        const int offset = (step + 1) / 2 * (step % 2 ? 1 : -1);
        const int around =
            ((int)lrint((behind - G_PI) * AROUND / (2 * G_PI)) + offset + 2 * AROUND) % AROUND;
        for (int ring = RINGS - 1; ring >= 0; ring--) {
            const double grey = 0.58 + 0.28 * cos(2 * G_PI * (around + 0.5) / AROUND - 2.4);
            fields_quad(plot, radius, ring, around);
            cairo_set_source_rgb(plot->cr, grey, grey, grey + 0.04);
            cairo_fill_preserve(plot->cr);
            cairo_set_source_rgba(plot->cr, 0, 0, 0, 0.12);
            cairo_set_line_width(plot->cr, 0.5);
            cairo_stroke(plot->cr);
        }
    }
}

static void fields_draw_wires(const struct plot *plot, const double *radius) {
    cairo_set_source_rgba(plot->cr, 0.82, 0.1, 0.1, 0.75);
    cairo_set_line_width(plot->cr, 0.6);
    for (int ring = 0; ring < RINGS; ring++)
        for (int around = 0; around < AROUND; around++) {
            fields_quad(plot, radius, ring, around);
            cairo_stroke(plot->cr);
        }
}

/* Measured luminances of a view, interpolated; radius: (RINGS + 1) × AROUND. */
static void fields_measured(const struct btf_matrix *btf, const Directions *lights, int view,
                            int texel, double *ret) {
    const gsize n_lights = btf->layout.lights.n;
    const float *values =
        btf->values + 3 * ((gsize)texel * btf->layout.views.n + (gsize)view) * n_lights;
    int n_pole;
    const int *pole = directions_pole(lights, &n_pole);
    for (int i = 0; i < (RINGS + 1) * AROUND; i++) {
        struct direction_weights w;
        const double fade =
            directions_fade_weights(lights, fields_light(i / AROUND, i % AROUND), &w);
        ret[i] = 0;
        for (int k = 0; k < 4; k++) {
            double value = 0;
            if (w.index[k] < (int)n_lights)
                value = (double)rgb_luminance(values + 3 * w.index[k]);
            for (int j = 0; w.index[k] >= (int)n_lights && j < n_pole; j++)
                value += (double)rgb_luminance(values + 3 * pole[j]) / n_pole;
            ret[i] += fade * (double)w.weight[k] * value;
        }
    }
}

#define PLOTTED 3

static gboolean fields_plot(const char *path, const struct btf_matrix *btf,
                            struct lobes *const lobes[PLOTTED], const int views[2], int texel,
                            GError **error) {
    static const char *const names[PLOTTED] = {"Lafortune, 2 lobes", "PTM", "non-linear, 2 lobes"};
    g_autoptr(Directions) lights = directions_new(
        btf->layout.lights.theta_deg, btf->layout.lights.phi_deg, (int)btf->layout.lights.n, error);
    if (lights == NULL)
        return FALSE;
    cairo_surface_t *surface =
        cairo_image_surface_create(CAIRO_FORMAT_RGB24, PLOTTED * PANEL, 2 * PANEL);
    cairo_t *cr = cairo_create(surface);
    cairo_set_source_rgb(cr, 1, 1, 1);
    cairo_paint(cr);
    cairo_select_font_face(cr, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(cr, 13);
    for (int row = 0; row < 2; row++) {
        double measured[(RINGS + 1) * AROUND], fit[(RINGS + 1) * AROUND], most = 1e-6;
        fields_measured(btf, lights, views[row], texel, measured);
        for (int i = 0; i < (RINGS + 1) * AROUND; i++)
            most = MAX(most, measured[i]);
        for (int k = 0; k < PLOTTED; k++) {
            const struct plot plot = {cr, (k + 0.5) * PANEL, (row + 0.8) * PANEL,
                                      0.6 * PANEL / most};
            for (int i = 0; i < (RINGS + 1) * AROUND; i++)
                fit[i] = MAX(0, fields_luminance(lobes[k], views[row], texel,
                                                 fields_light(i / AROUND, i % AROUND)));
            fields_draw_solid(&plot, measured);
            fields_draw_wires(&plot, fit);
            g_autofree char *text = g_strdup_printf(
                "%s, view %.0f°, %.0f°", names[k], (double)btf->layout.views.theta_deg[views[row]],
                fmod((double)btf->layout.views.phi_deg[views[row]] + 360, 360));
            cairo_set_source_rgb(cr, 0.1, 0.1, 0.1);
            cairo_move_to(cr, k * PANEL + 12, row * PANEL + 22);
            cairo_show_text(cr, text);
            cairo_new_path(cr);
        }
    }
    const cairo_status_t status = cairo_surface_write_to_png(surface, path);
    cairo_destroy(cr);
    cairo_surface_destroy(surface);
    if (status != CAIRO_STATUS_SUCCESS)
        bench_fail(1, "%s: %s", path, cairo_status_to_string(status));
    return TRUE;
}

/* A steep view, and the one farthest from it. */
static void fields_two_views(const struct btf_matrix *btf, int ret[2]) {
    double least = 2;
    ret[0] = ret[1] = 0;
    for (gsize v = 1; v < btf->layout.views.n; v++)
        if (btf->layout.views.theta_deg[v] < btf->layout.views.theta_deg[ret[0]])
            ret[0] = (int)v;
    for (gsize v = 0; v < btf->layout.views.n; v++) {
        const double dot = vec3_dot(fields_direction(&btf->layout.views, v),
                                    fields_direction(&btf->layout.views, (gsize)ret[0]));
        if (dot < least) {
            least = dot;
            ret[1] = (int)v;
        }
    }
}

static void fields_session(const char *path, const char *plot, int texel, gboolean energy,
                           GError **error) {
    static const enum lobes_model models[PLOTTED] = {LOBES_LAFORTUNE, LOBES_PTM, LOBES_FIELDS};
    g_autoptr(BtfMatrix) btf = btf_matrix_read(path, NULL, error);
    struct lobes *lobes[PLOTTED] = {NULL};
    if (btf == NULL || btf->layout.views.n == 0 || btf->layout.lights.n == 0)
        return;
    const int n_texels = (int)btf_layout_texels(&btf->layout);
    if (texel < 0)
        texel = (int)(btf->layout.height / 2 * btf->layout.width + btf->layout.width / 2);
    if (texel >= n_texels)
        bench_fail(2, "%s has %d texels", path, n_texels);
    bench_begin(NULL);
    bench_put("%s{name}", btf->name);
    fields_print_steps(btf);
    if (!energy)
        fields_print_fits(btf);
    for (int k = 0; !energy && k < PLOTTED; k++) {
        const struct lobes_options options = {.model = models[k]};
        lobes[k] = lobes_compute(btf, &options, NULL);
        bench_put_double(lobes_model_name(models[k]), "_horizon", "%.4f",
                         fields_horizon(btf, lobes[k]));
    }
    bench_end();
    if (energy)
        return;
    if (plot) {
        int views[2];
        fields_two_views(btf, views);
        fields_plot(plot, btf, lobes, views, texel, error);
    }
    for (int k = 0; k < PLOTTED; k++)
        lobes_free(lobes[k]);
}

int main(int argc, char **argv) {
    gboolean energy = FALSE;
    int texel = -1;
    g_autofree char *plot = NULL;
    const GOptionEntry entries[] = {
        {"energy", 0, 0, G_OPTION_ARG_NONE, &energy, "The energy alone, without fits", NULL},
        {"plot", 0, 0, G_OPTION_ARG_FILENAME, &plot, "Draw a texel of the last session", "OUT.png"},
        {"texel", 0, 0, G_OPTION_ARG_INT, &texel, "Which one, row by row (the middle)", "N"},
        {NULL}};
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, "SESSION…");
    if (argc < 2)
        bench_fail(2, "name a session");
    bench_begin(NULL);
    bench_begin_list("materials");
    for (int i = 1; i < argc && !error; i++)
        fields_session(argv[i], i == argc - 1 ? plot : NULL, texel, energy, &error);
    bench_end();
    bench_end();
    bench_check(error);
    return 0;
}
