/*
 * How far measured BTFs are from the simulated world's own truth, for four materials and a grid of
 * views and lights, all noise on, geometry exact: what is left is the error of the method.
 *
 * Of each material five views (15, 30, 45, 60, 75° from the normal, at turntable angles of their
 * own) under five lamps of the same elevations. A texel is at least --pixels pixels across, in the
 * direction in which a view shortens it too.
 */
#include "measurement_btf.h"

#include <stdio.h>
#include <stdlib.h>

#define PAIRS     (RIG_VIEWS * RIG_VIEWS)
#define STEEP_DEG 60 /* beyond it another limit holds */

static int texels = 24, supersample = 4, samples = 24;
static double pixels = 3;
static gboolean json, quiet;
static char *only;

static const GOptionEntry entries[] = {
    {"json", 0, 0, G_OPTION_ARG_NONE, &json, "One JSON object", NULL},
    {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Texels across, 0.78 mm each (24)", "N"},
    {"pixels", 0, 0, G_OPTION_ARG_DOUBLE, &pixels, "Camera pixels a texel, at least (3)", "N"},
    {"supersample", 0, 0, G_OPTION_ARG_INT, &supersample, "Rays a pixel, in x and y (4)", "N"},
    {"samples", 0, 0, G_OPTION_ARG_INT, &samples, "Rays a texel of the truth (24)", "N"},
    {"quiet", 0, 0, G_OPTION_ARG_NONE, &quiet, "Cameras without noise", NULL},
    {"only", 0, 0, G_OPTION_ARG_STRING, &only, "One material", "KIND"},
    {NULL},
};

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

static void print_group(const char *name, struct bench_cell *cells, gboolean steep) {
    g_autoptr(GArray) all = g_array_new(FALSE, FALSE, sizeof(float));
    for (int i = 0; i < PAIRS; i++)
        if (is_steep(i) == steep)
            g_array_append_vals(all, cells[i].errors->data, cells[i].errors->len);
    printf(json ? "\"%s_median\": %.5f, \"%s_p95\": %.5f, "
                : "  %s: median %.2f %%, %s p95 %.2f %%\n",
           name, bench_quantile(all, 0.5) * (json ? 1 : 100), name,
           bench_quantile(all, 0.95) * (json ? 1 : 100));
}

static void print_table(struct bench_cell *cells) {
    printf(json ? "\"view_light_median_p95\": ["
                : "  rows: view 15 … 75°, columns: light 15 … 75°\n");
    for (int i = 0; i < PAIRS; i++) {
        double median = bench_quantile(cells[i].errors, 0.5);
        double p95 = bench_quantile(cells[i].errors, 0.95);
        if (json)
            printf("%s[%.5f, %.5f]", i ? ", " : "", median, p95);
        else
            printf("%8.2f /%6.2f%s", 100 * median, 100 * p95, i % RIG_VIEWS < 4 ? "" : "\n");
    }
    printf(json ? "]" : "");
}

static void measure(const char *material, gboolean first) {
    struct bench_setup setup = {.material = material,
                                .texels = texels,
                                .texel_mm = 50.0 / 64,
                                .pixels_a_texel = pixels,
                                .supersample = supersample,
                                .gather_rays = 12,
                                .noise = !quiet};
    struct bench_cell cells[PAIRS];
    for (int i = 0; i < PAIRS; i++)
        cells[i] = (struct bench_cell){.errors = g_array_new(FALSE, FALSE, sizeof(float)),
                                       .bias = g_array_new(FALSE, FALSE, sizeof(float))};
    bench_btf(&setup, samples, cells);
    printf(json ? "%s\"%s\": {" : "%s%s\n", json && !first ? ", " : "", material);
    print_group("btf_to_60deg", cells, FALSE);
    print_group("btf_75deg", cells, TRUE);
    print_table(cells);
    printf(json ? "}" : "");
    fflush(stdout);
    clear_cells(cells);
}

int main(int argc, char **argv) {
    static const char *const materials[] = {"weave", "brick", "peanuts", "brushed"};
    g_autoptr(GError) error = NULL;
    g_autoptr(GOptionContext) context = g_option_context_new(NULL);
    g_option_context_add_main_entries(context, entries, NULL);
    if (!g_option_context_parse(context, &argc, &argv, &error)) {
        fprintf(stderr, "bench_measurement: %s\n", error->message);
        return 2;
    }
    printf(json ? "{\"pixels_a_texel\": %g, " : "at least %g pixels a texel\n", pixels);
    gboolean first = TRUE;
    for (gsize i = 0; i < G_N_ELEMENTS(materials); i++)
        if (!only || g_str_equal(only, materials[i])) {
            measure(materials[i], first);
            first = FALSE;
        }
    printf(json ? "}\n" : "");
    return 0;
}
