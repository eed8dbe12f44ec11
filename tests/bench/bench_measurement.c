/*
 * Compares measured BTFs and MDFs with the truth of the simulated world, for four materials and a
 * grid of views and lights. All noise is on, and the geometry is exact, so that only the error of
 * the method is left.
 *
 * Of each material five views (15, 30, 45, 60, 75° from the normal, at turntable angles of their
 * own); for the BTF five lamps of the same elevations, for the MDF the demo's 26 laser positions. A
 * texel is at least --pixels pixels across, in the direction in which a view shortens it too. At an
 * edge means with a step of half a texel within one texel.
 */
#include "bench.h"
#include "mdf/mdf_views.h"
#include "measurement_parts.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PAIRS         (RIG_VIEWS * RIG_VIEWS)
#define STEEP_DEG     60     /* beyond it another limit holds */
#define SHOWN_VIEW    2      /* from 45°, of the MDF's pictures */
#define NORMAL_MEDIAN 0.4549 /* of the square of a standard normal deviate */

static int texels = 24, supersample = 4, samples = 24;
static double pixels = 3;
static int steps = 64, every = 1;
static double relief_mm;
static gboolean quiet, mono, curve, no_btf, no_mdf, only_mdf_pictures, plain_merge;
static char *only, *pictures;

static const GOptionEntry entries[] = {
    {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Texels across, 0.78 mm each (24)", "N"},
    {"pixels", 0, 0, G_OPTION_ARG_DOUBLE, &pixels, "Camera pixels a texel, at least (3)", "N"},
    {"supersample", 0, 0, G_OPTION_ARG_INT, &supersample, "Rays a pixel, in x and y (4)", "N"},
    {"samples", 0, 0, G_OPTION_ARG_INT, &samples, "Rays a texel of the truth (24)", "N"},
    {"quiet", 0, 0, G_OPTION_ARG_NONE, &quiet, "Cameras without noise", NULL},
    {"mono", 0, 0, G_OPTION_ARG_NONE, &mono, "Cameras without a colour filter", NULL},
    {"curve", 0, 0, G_OPTION_ARG_NONE, &curve, "Only BTFs, over pixels a texel", NULL},
    {"steps", 0, 0, G_OPTION_ARG_INT, &steps, "Frames a laser sweep (64)", "N"},
    {"no-btf", 0, 0, G_OPTION_ARG_NONE, &no_btf, "Leave the BTF out", NULL},
    {"no-mdf", 0, 0, G_OPTION_ARG_NONE, &no_mdf, "Leave the MDF out", NULL},
    {"plain-merge", 0, 0, G_OPTION_ARG_NONE, &plain_merge,
     "Merge laser positions by the plain mean of Wang et al. 2005", NULL},
    {"every", 0, 0, G_OPTION_ARG_INT, &every, "Only every N-th of the 26 laser positions (1)", "N"},
    {"only", 0, 0, G_OPTION_ARG_STRING, &only, "One material, or another kind of sample", "KIND"},
    {"relief", 0, 0, G_OPTION_ARG_DOUBLE, &relief_mm, "Its relief, instead of its own", "MM"},
    {"pictures", 0, 0, G_OPTION_ARG_FILENAME, &pictures,
     "Also draw BTFs and MDFs, measured and true, into DIR/btf_KIND.png and DIR/mdf_KIND.png",
     "DIR"},
    {"only-mdf-pictures", 0, 0, G_OPTION_ARG_NONE, &only_mdf_pictures,
     "With --pictures: draw the MDFs, and measure nothing else", NULL},
    {NULL},
};

static void new_cells(struct bench_cell *cells) {
    for (int i = 0; i < PAIRS; i++)
        cells[i] = (struct bench_cell){.errors = g_array_new(FALSE, FALSE, sizeof(float)),
                                       .bias = g_array_new(FALSE, FALSE, sizeof(float))};
}

static void clear_cells(struct bench_cell *cells) {
    for (int i = 0; i < PAIRS; i++) {
        g_array_unref(cells[i].errors);
        g_array_unref(cells[i].bias);
    }
}

static gboolean is_steep(int pair) {
    return bench_elevation_deg(pair / RIG_VIEWS) > STEEP_DEG ||
           bench_elevation_deg(pair % RIG_VIEWS) > STEEP_DEG;
}

struct errors {
    double median, p95;
};

static struct errors group_errors(const struct bench_cell *cells, gboolean steep) {
    g_autoptr(GArray) all = g_array_new(FALSE, FALSE, sizeof(float));
    for (int i = 0; i < PAIRS; i++)
        if (is_steep(i) == steep)
            g_array_append_vals(all, cells[i].errors->data, cells[i].errors->len);
    double median = bench_quantile(all, 0.5);
    return (struct errors){median, bench_quantile(all, 0.95)};
}

static struct errors btf_limit(gboolean steep) {
    return steep ? (struct errors){0.02, 0.08} : (struct errors){0.01, 0.04};
}

static void print_group(const char *name, const struct bench_cell *cells, gboolean steep) {
    struct errors e = group_errors(cells, steep), limit = btf_limit(steep);
    bench_put_double(name, "_median", "%.5f", e.median);
    bench_put_double(name, "_median_limit", "%.5f", limit.median);
    bench_put_double(name, "_p95", "%.5f", e.p95);
    bench_put_double(name, "_p95_limit", "%.5f", limit.p95);
}

/* With every kind of camera, to tell what of the errors is noise, what the colour filter, and what
 * any camera of as many pixels has: a texel's border does not follow those of pixels. Values:
 * median and 95th percentile up to 60°, and at 75°. */
static const struct {
    const char *name;
    gboolean mono, quiet;
} cameras[] = {{"colour", FALSE, FALSE},
               {"colour_quiet", FALSE, TRUE},
               {"mono", TRUE, FALSE},
               {"mono_quiet", TRUE, TRUE}};

static void print_cameras(struct bench_setup setup) {
    for (gsize k = 0; k < G_N_ELEMENTS(cameras); k++) {
        struct bench_cell cells[PAIRS];
        new_cells(cells);
        setup.mono = cameras[k].mono;
        setup.noise = !cameras[k].quiet;
        bench_btf(&setup, samples, cells, NULL);
        struct errors flat = group_errors(cells, FALSE), steep = group_errors(cells, TRUE);
        const double all[] = {flat.median, flat.p95, steep.median, steep.p95};
        bench_put_doubles(cameras[k].name, "%.5f", all, G_N_ELEMENTS(all));
        clear_cells(cells);
    }
}

static void print_curve(struct bench_setup setup) {
    static const double all[] = {2, 3, 4, 5, 6};
    bench_begin_list("curve");
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++) {
        setup.pixels_a_texel = all[i];
        bench_begin(NULL);
        bench_put("%g{pixels}", all[i]);
        print_cameras(setup);
        bench_end();
    }
    bench_end();
}

/* Of error bars (btf_sigma.h), for each view's elevation, and of all values together. */
static void print_chi_squares(const struct bench_cell *cells) {
    struct bench_cell all = {0};
    double chi2[RIG_VIEWS];
    bench_begin_list("btf_chi_square");
    for (int view = 0; view <= RIG_VIEWS; view++) {
        struct bench_cell sum = {0};
        for (int i = view * RIG_VIEWS; view < RIG_VIEWS && i < (view + 1) * RIG_VIEWS; i++) {
            sum.chi += cells[i].chi;
            sum.chi_noise += cells[i].chi_noise;
            sum.values += cells[i].values;
            sum.beyond += cells[i].beyond;
        }
        all.chi += sum.chi;
        all.chi_noise += sum.chi_noise;
        all.values += sum.values;
        all.beyond += sum.beyond;
        const struct bench_cell *cell = view < RIG_VIEWS ? &sum : &all;
        const double n = (double)cell->values;
        if (view < RIG_VIEWS)
            chi2[view] = cell->chi / n;
        /* −1: all views. */
        bench_row(NULL, "%g{elevation_deg} %.4f{chi_square} %.4f{noise_alone} %.5f{beyond_3_sigma}",
                  view < RIG_VIEWS ? bench_elevation_deg(view) : -1, cell->chi / n,
                  cell->chi_noise / n, (double)cell->beyond / n);
    }
    bench_end();
    bench_put_doubles("chi2_btf", "%.4f", chi2, RIG_VIEWS);
}

static double part(gint64 n, gint64 of) {
    return of > 0 ? (double)n / (double)of : 0;
}

static double rms(double squares, gint64 n) {
    return n > 0 ? sqrt(squares / (double)n) : 0;
}

static double mean_of(GArray *values) {
    double sum = 0;
    for (guint i = 0; i < values->len; i++)
        sum += (double)g_array_index(values, float, i);
    return values->len > 0 ? sum / values->len : NAN;
}

/* χ² of error bars: number of texels, mean ((d − truth) / σ)², and its median over that of a normal
 * deviate's square, which a few large errors do not move. Both are 1 where error bars are right. */
static void print_chi2(const char *name, GArray *chi2) {
    const double all[] = {chi2->len, mean_of(chi2), bench_quantile(chi2, 0.5) / NORMAL_MEDIAN};
    if (chi2->len > 0)
        bench_put_doubles(name, "%.6g", all, G_N_ELEMENTS(all));
}

static void print_view(int view, struct bench_mdf *m) {
    bench_begin(NULL);
    bench_put("%.0f{view_deg} %.4f{rms_texels} %.4f{median_texels} %.4f{mean_texels} "
              "%.4f{edge_texels} %.4f{edge_rms_texels} %.4f{coverage} %.4f{coverage_of_shown} "
              "%" G_GINT64_FORMAT "{dark} %.4f{outliers} %.4f{outliers_with_edges}",
              bench_elevation_deg(view), rms(m->squares, m->measured),
              bench_quantile(m->errors, 0.5), m->sum / (double)MAX(m->measured, 1),
              part(m->edges, m->edges + m->measured), rms(m->edge_squares, m->edges),
              part(m->covered, m->seen), part(m->covered, m->seen - m->dark), m->dark,
              part(m->outliers, m->measured),
              part(m->outliers + m->edge_outliers, m->edges + m->measured));
    print_chi2("chi2", m->chi2);
    print_chi2("edge_chi2", m->edge_chi2);
    print_chi2("alone_chi2", m->alone_chi2);
    bench_put("%" G_GINT64_FORMAT "{alone} %.4f{alone_outliers} %.4f{alone_rms_texels}", m->alone,
              part(m->alone_outliers, m->alone), rms(m->alone_squares, m->alone));
    bench_end();
}

/* What the views say of each other's outliers, those at edges included. */
struct agreement {
    gint64 measured, outliers, refuted, refuted_outliers;
};

/* What one kind of texels' distances are worth. */
struct worth {
    gint64 n, outliers;
    double squares;
};

static void add_worth(struct worth *to, float mm, float truth, double texel_mm) {
    const double error = (double)(mm - truth) / texel_mm;
    to->n++;
    to->outliers += fabs(error) > 1;
    to->squares += error * error;
}

/* Before and after the views have settled what is where; n is of lit texels, per source. */
struct settled {
    gint64 lit, before, after[MDF_PREDICTED + 1];
    struct worth off_before, off_after, edge_before, edge_after, source[MDF_PREDICTED + 1], removed;
};

static void print_worth(const char *name, const struct worth *w) {
    bench_row(name, "%" G_GINT64_FORMAT "{n} %.5f{outliers} %.4f{rms_texels}", w->n,
              part(w->outliers, w->n), rms(w->squares, w->n));
}

static void print_settled(const struct bench_setup *setup, const struct bench_mdf *all) {
    const struct mdf_plane plane = {setup->texels, setup->texels, setup->texel_mm,
                                    bench_grid(setup).reference_mm};
    struct mdf_eye eyes[RIG_VIEWS];
    struct settled s = {0};
    for (int v = 0; v < RIG_VIEWS; v++) {
        memcpy(eyes[v].centre_mm, all[v].centre_mm, sizeof eyes[v].centre_mm);
        eyes[v].distance = all[v].distance;
        eyes[v].other = all[v].other;
        eyes[v].lasers = all[v].lasers;
    }
    for (int v = 0; v < RIG_VIEWS; v++) {
        const int n = setup->texels * setup->texels;
        g_autofree float *mm = g_new(float, n);
        g_autofree guint8 *source = g_new(guint8, n);
        mdf_views_settle(eyes, RIG_VIEWS, v, &plane, mm, source);
        for (int i = 0; i < n; i++) {
            const float before = all[v].distance[i], truth = all[v].truth[i];
            s.lit += all[v].lit[i] > 0;
            s.before += all[v].lit[i] > 0 && before >= 0;
            s.after[source[i]] += all[v].lit[i] > 0;
            if (truth < 0)
                continue;
            if (before >= 0)
                add_worth(all[v].edge[i] ? &s.edge_before : &s.off_before, before, truth,
                          setup->texel_mm);
            if (mm[i] >= 0)
                add_worth(all[v].edge[i] ? &s.edge_after : &s.off_after, mm[i], truth,
                          setup->texel_mm);
            if (mm[i] >= 0)
                add_worth(&s.source[source[i]], mm[i], truth, setup->texel_mm);
            if (before >= 0 && source[i] != MDF_MEASURED)
                add_worth(&s.removed, before, truth, setup->texel_mm);
        }
    }
    bench_begin("mdf_settled");
    bench_put("%.5f{coverage_before} %.5f{coverage_measured} %.5f{coverage_with_predicted}",
              part(s.before, s.lit), part(s.after[MDF_MEASURED] + s.after[MDF_OTHER], s.lit),
              part(s.lit - s.after[MDF_UNSEEN], s.lit));
    print_worth("off_edges_before", &s.off_before);
    print_worth("off_edges_after", &s.off_after);
    print_worth("edges_before", &s.edge_before);
    print_worth("edges_after", &s.edge_after);
    print_worth("second_choice", &s.source[MDF_OTHER]);
    print_worth("predicted", &s.source[MDF_PREDICTED]);
    print_worth("taken_back", &s.removed);
    bench_end();
}

static void draw_mdf(const struct bench_setup *setup, const struct bench_mdf *view) {
    g_autoptr(GError) error = NULL;
    g_autofree char *name = g_strdup_printf("mdf_%s.png", setup->material);
    g_autofree char *path = g_build_filename(pictures, name, NULL);
    const struct session_grid grid = bench_grid(setup);
    if (!demo_write_mdf(path, &grid, view->distance, view->truth, &error))
        fprintf(stderr, "bench_measurement: %s\n", error->message);
}

static void print_mdf(const struct bench_setup *setup) {
    struct bench_mdf all[RIG_VIEWS];
    struct agreement a = {0};
    double chi2[RIG_VIEWS], edges[RIG_VIEWS];
    bench_begin_list("mdf");
    for (int view = 0; view < RIG_VIEWS; view++) {
        bench_mdf_init(&all[view]);
        bench_mdf(setup, view, steps, every, plain_merge, &all[view]);
        print_view(view, &all[view]);
        chi2[view] = mean_of(all[view].chi2);
        edges[view] = mean_of(all[view].edge_chi2);
    }
    bench_end();
    if (pictures)
        draw_mdf(setup, &all[SHOWN_VIEW]);
    struct mdf_plane plane = {setup->texels, setup->texels, setup->texel_mm,
                              bench_grid(setup).reference_mm};
    struct mdf_eye eyes[RIG_VIEWS];
    int n = setup->texels * setup->texels;
    g_autofree guint16 *confirmed = g_new(guint16, n), *denied = g_new(guint16, n);
    for (int v = 0; v < RIG_VIEWS; v++) {
        memcpy(eyes[v].centre_mm, all[v].centre_mm, sizeof eyes[v].centre_mm);
        eyes[v].distance = all[v].distance;
    }
    for (int v = 0; v < RIG_VIEWS; v++) {
        mdf_views_compare(eyes, RIG_VIEWS, v, &plane, confirmed, denied);
        for (int i = 0; i < n; i++) {
            if (all[v].distance[i] < 0 || all[v].truth[i] < 0)
                continue;
            gboolean out = fabsf(all[v].distance[i] - all[v].truth[i]) > (float)setup->texel_mm;
            gboolean refuted = mdf_views_refuted(confirmed[i], denied[i]);
            a.measured++;
            a.outliers += out;
            a.refuted += refuted;
            a.refuted_outliers += refuted && out;
        }
    }
    gint64 kept = a.measured - a.refuted, left = a.outliers - a.refuted_outliers;
    bench_put("%.5f{mdf_outliers} %.5f{mdf_refuted} %.5f{mdf_outliers_unrefuted}",
              part(a.outliers, a.measured), part(a.refuted, a.measured), part(left, kept));
    print_settled(setup, all);
    bench_put_doubles("chi2_mdf", "%.4f", chi2, RIG_VIEWS);
    bench_put_doubles("chi2_mdf_edges", "%.4f", edges, RIG_VIEWS);
    for (int view = 0; view < RIG_VIEWS; view++)
        bench_mdf_clear(&all[view]);
}

/* RMS of a pulse's time in frames, and its ratio to the Cramér-Rao bound (limit 1.3). 96 steps over
 * 50 mm give σ = 0.7 frames. Finer steps, slanted surfaces and wide lines give more. */
static void print_peaks(void) {
    static const double sigmas[] = {0.6, 0.7, 1, 1.4, 2, 3};
    bench_begin_list("peaks");
    for (gsize i = 0; i < G_N_ELEMENTS(sigmas); i++)
        for (double dn = 20; dn < 4000; dn *= 2) {
            struct bench_peaks p = bench_peaks(dn, sigmas[i]);
            bench_row(NULL, "%.1f{sigma_frames} %.0f{dn} %.5f{rms} %.3f{ratio} %.5f{missed}",
                      sigmas[i], dn, p.rms, p.rms / p.bound, p.missed);
        }
    bench_end();
}

/* 128 × 128 texels, from 45°. */
static void print_speed(void) {
    struct bench_setup setup = {
        .material = "weave", .texels = 128, .texel_mm = 0.390625, .pixels_a_texel = pixels};
    struct bench_speed s = bench_speed(&setup, 2);
    bench_row("speed",
              "%.2f{decode_ms} %.2f{rectify_ms} %.2f{errors_ms} %.0f{prepare_ms} %.0f{guide_ms}",
              s.decode_ms, s.rectify_ms, s.errors_ms, s.prepare_ms, s.guide_ms);
}

static void draw(const char *material, const struct demo_btf *picture) {
    g_autoptr(GError) error = NULL;
    g_autofree char *name = g_strdup_printf("btf_%s.png", material);
    g_autofree char *path = g_build_filename(pictures, name, NULL);
    if (!demo_btf_write(picture, path, &error))
        fprintf(stderr, "bench_measurement: %s\n", error->message);
}

static void measure(const char *material) {
    struct bench_setup setup = {.material = material,
                                .relief_mm = relief_mm,
                                .texels = texels,
                                .texel_mm = 50.0 / 64,
                                .pixels_a_texel = pixels,
                                .supersample = supersample,
                                .gather_rays = 12,
                                .noise = !quiet,
                                .mono = mono};
    struct bench_cell cells[PAIRS];
    new_cells(cells);
    bench_begin(material);
    if (curve)
        print_curve(setup);
    else if (pictures && only_mdf_pictures) {
        struct bench_mdf view;
        bench_mdf_init(&view);
        bench_mdf(&setup, SHOWN_VIEW, steps, every, plain_merge, &view);
        draw_mdf(&setup, &view);
        bench_mdf_clear(&view);
    } else if (!no_mdf)
        print_mdf(&setup);
    if (!no_btf && !curve && !only_mdf_pictures) {
        struct session_grid grid = bench_grid(&setup);
        struct demo_btf *picture = pictures ? demo_btf_new(&grid) : NULL;
        bench_btf(&setup, samples, cells, picture);
        if (picture)
            draw(material, picture);
        demo_btf_free(picture);
        print_group("btf_to_60deg", cells, FALSE);
        print_group("btf_75deg", cells, TRUE);
        bench_begin_list("view_light_median_p95");
        for (int i = 0; i < PAIRS; i++)
            bench_row(NULL, "%.0f{view_deg} %.0f{light_deg} %.5f{median} %.5f{p95}",
                      bench_elevation_deg(i / RIG_VIEWS), bench_elevation_deg(i % RIG_VIEWS),
                      bench_quantile(cells[i].errors, 0.5), bench_quantile(cells[i].errors, 0.95));
        bench_end();
        print_chi_squares(cells);
    }
    bench_end();
    clear_cells(cells);
}

int main(int argc, char **argv) {
    static const char *const materials[] = {"weave", "brick", "peanuts", "brushed"};
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, NULL);
    if (every < 1) {
        fprintf(stderr, "bench_measurement: --every is %d, and must be 1 or more\n", every);
        return 2;
    }
    bench_begin(NULL);
    bench_put("%g{pixels_a_texel}", pixels);
    print_peaks();
    print_speed();
    for (gsize i = 0; !only && i < G_N_ELEMENTS(materials); i++)
        measure(materials[i]);
    if (only)
        measure(only);
    bench_end();
    return 0;
}
