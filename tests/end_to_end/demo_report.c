/*
 * Compares a session with the truth of the simulated world in which it was captured: the figures of
 * demo/report.json, and pictures of the measurement next to the truth. With --nominal, the same
 * frames processed without a calibration are compared as well.
 */
#include "base/work.h"
#include "btf/btf_sigma.h"
#include "demo_calibration.h"
#include "demo_pictures.h"
#include "lib/floats.h"
#include "mdf/mdf_views.h"
#include "rig/devices.h"

#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* A texel, in x and y: edges of shadows need many. */
#define TRUTH_SAMPLES 12
#define SHEETS        5 /* of each sweep, whose sheets are compared */
#define BEYOND_SIGMA  3

enum { CALIBRATED, NOMINAL, KINDS };

struct mdf_sums {
    double squares, squares_all;
    gint64 n, n_all, covered, seen, outliers, texels;
    GArray *errors;
    double chi2; /* sum of the squares of errors relative to their error bars, next to no edge */
    gint64 n_bars, beyond; /* with error bars; off by more than 3 of them */
};

struct products { /* what was made of the frames */
    Session *session;
    struct exr_file *mdf;
    struct mdf_sums sums;
    GArray *errors, *steep; /* of captured pictures, relative; steep: from views below 30° */
    /* sums of squares of differences and of true values: captured pictures, and left out ones */
    double differences[2], values[2];
    double chi2; /* as that of the MDF */
    gint64 n_bars, beyond;
};

struct report {
    struct products products[KINDS];
    int n_kinds;
    struct calibration *calibrations[KINDS];
    World *world;
    struct session_grid grid;
    struct truth_grid texels;
    GPtrArray *views, *lights, *lasers, *shots;
    struct demo_btf *picture;
    GString *json;
};

static char *mdf_png, *btf_png, *facts, *nominal;
static int btf_pairs = 120;
static const GOptionEntry entries[] = {
    {"mdf-png", 0, 0, G_OPTION_ARG_FILENAME, &mdf_png, "MDF of one view beside the truth", "PNG"},
    {"btf-png", 0, 0, G_OPTION_ARG_FILENAME, &btf_png, "BTF pictures beside the truth", "PNG"},
    {"btf-pairs", 0, 0, G_OPTION_ARG_INT, &btf_pairs, "How many (view, light) pairs to trace", "N"},
    {"nominal", 0, 0, G_OPTION_ARG_FILENAME, &nominal,
     "The same frames processed with --calibration nominal", "SESSION"},
    {"facts", 0, 0, G_OPTION_ARG_STRING, &facts, "More members for the report, as JSON text",
     "TEXT"},
    {NULL},
};

static double quantile(GArray *sorted, double q) {
    return sorted->len == 0 ? NAN : g_array_index(sorted, float, (guint)(q * (sorted->len - 1)));
}

static Session *session_of(const struct report *report) {
    return report->products[CALIBRATED].session;
}

static void add_value_to(GString *json, const char *name, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(text, sizeof text, "%.6g", value);
    g_string_append_printf(json, "\"%s\": %s", name, isfinite(value) ? text : "null");
}

static void add_number(GString *json, const char *name, double value) {
    g_string_append(json, "  ");
    add_value_to(json, name, value);
    g_string_append(json, ",\n");
}

static void add_value(struct report *report, const char *name, const char *key) {
    g_autofree char *value = session_value(session_of(report), key);
    add_number(report->json, name, value ? g_ascii_strtod(value, NULL) : NAN);
}

/* The laser positions that swept a view: those of the sweeps at its turntable angle. */
static int lasers_of_view(const struct report *report, const struct session_direction *view,
                          double *arc_deg, int *laser) {
    int n = 0;
    for (guint i = 0; i < report->shots->len; i++) {
        const struct session_shot *shot = g_ptr_array_index(report->shots, i);
        if (shot->kind != SHOT_SWEEP || shot->state != SHOT_DONE ||
            !camera_set_has(shot->cameras, view->device) ||
            fabs(shot->turntable_deg - view->turntable_deg) > 1e-6)
            continue;
        arc_deg[n] = shot->arc_deg;
        laser[n++] = shot->device;
    }
    return n;
}

static void compare_mdf_view(struct report *report, guint v, const float *truth, const guint8 *edge,
                             const guint8 *seen) {
    const struct session_direction *view = g_ptr_array_index(report->views, v);
    g_autofree char *name = g_strdup_printf("view_%04d", view->index);
    const double texel_mm = report->grid.width_mm / report->grid.width;
    for (int k = 0; k < report->n_kinds; k++) {
        const struct exr_part *part = exr_file_part(report->products[k].mdf, name);
        const float *measured = part ? exr_part_plane(part, "D") : NULL;
        const float *from = part ? exr_part_plane(part, "P") : NULL;
        const float *bars = part ? exr_part_plane(part, "S") : NULL;
        struct mdf_sums *sums = &report->products[k].sums;
        if (measured && from) {
            /* What other views predict is not measured, so that it counts as nothing here. */
            for (int i = 0; i < report->grid.width * report->grid.height; i++) {
                gboolean known = measured[i] >= 0 && (int)from[i] != MDF_PREDICTED;
                sums->texels++;
                sums->seen += seen[i] > 0;
                sums->covered += seen[i] > 0 && known;
                if (!known)
                    continue;
                const float error = fabsf(measured[i] - truth[i]);
                sums->squares_all += (double)error * error;
                sums->n_all++;
                sums->outliers += error > texel_mm;
                if (edge[i])
                    continue;
                sums->squares += (double)error * error;
                sums->n++;
                g_array_append_val(sums->errors, error);
                if ((int)from[i] != MDF_MEASURED || !bars || !(bars[i] > 0))
                    continue;
                sums->n_bars++;
                sums->chi2 += pow((double)(error / bars[i]), 2);
                sums->beyond += error > BEYOND_SIGMA * bars[i];
            }
        }
    }
}

static gboolean draw_mdf_view(const struct report *report, guint v, const float *truth,
                              GError **error) {
    const struct session_direction *view = g_ptr_array_index(report->views, v);
    g_autofree char *name = g_strdup_printf("view_%04d", view->index);
    const struct exr_part *part = exr_file_part(report->products[CALIBRATED].mdf, name);
    const float *measured = part ? exr_part_plane(part, "D") : NULL;
    return !measured || demo_write_mdf(mdf_png, &report->grid, measured, truth, error);
}

/* What is true of views, a plane of texels each. */
struct mdf_truth {
    const struct report *report;
    float *distance_mm;
    guint8 *edge, *seen; /* near a depth edge; by how many laser positions */
};

static void trace_mdf_view(int v, gpointer data) {
    const struct mdf_truth *truth = data;
    const struct report *report = truth->report;
    const struct session_direction *view = g_ptr_array_index(report->views, (guint)v);
    const gsize at = (gsize)v * (gsize)(report->grid.width * report->grid.height);
    g_autofree double *arc_deg = g_new(double, report->shots->len);
    g_autofree int *laser = g_new(int, report->shots->len);
    truth_mdf(report->world, view->device, view->turntable_deg, &report->texels,
              truth->distance_mm + at, truth->edge + at);
    const int n_lasers = lasers_of_view(report, view, arc_deg, laser);
    truth_laser_seen(report->world, view->device, view->turntable_deg, &report->texels, arc_deg,
                     laser, n_lasers, truth->seen + at);
}

static gboolean measure_mdf(struct report *report, GError **error) {
    const gsize n = (gsize)(report->grid.width * report->grid.height);
    g_autofree float *distance_mm = g_new(float, report->views->len *n);
    g_autofree guint8 *edge = g_new(guint8, report->views->len * n);
    g_autofree guint8 *seen = g_new(guint8, report->views->len * n);
    struct mdf_truth truth = {report, distance_mm, edge, seen};
    work_for_each(0, (int)report->views->len, trace_mdf_view, &truth);
    for (guint v = 0; v < report->views->len; v++) {
        compare_mdf_view(report, v, distance_mm + v * n, edge + v * n, seen + v * n);
        if (mdf_png && v == report->views->len * 2 / 5 &&
            !draw_mdf_view(report, v, distance_mm + v * n, error))
            return FALSE;
    }
    return TRUE;
}

/* The shot of a pair; adaptive sampling may have left it out. */
static const struct session_shot *find_lamp_shot(const struct report *report,
                                                 const struct session_direction *view, int light) {
    for (guint i = 0; i < report->shots->len; i++) {
        const struct session_shot *shot = g_ptr_array_index(report->shots, i);
        if (shot->kind == SHOT_LAMP && shot->source == light &&
            (shot->state == SHOT_DONE || shot->state == SHOT_SKIPPED) &&
            camera_set_has(shot->cameras, view->device) &&
            fabs(shot->turntable_deg - view->turntable_deg) < 1e-6)
            return shot;
    }
    return NULL;
}

static gboolean measure_btf_pair(struct report *report, const struct session_direction *view,
                                 const struct session_direction *light, const float *truth,
                                 gboolean left_out, gboolean draw, GError **error) {
    for (int k = 0; k < report->n_kinds; k++) {
        g_autofree char *relative = g_strdup_printf("products/btf/view_%04d.exr", view->index);
        g_autofree char *path = session_file(report->products[k].session, relative);
        g_autofree char *name = g_strdup_printf("light_%04d", light->index);
        struct exr_part *part = exr_read_part(path, name, error);
        if (!part)
            return FALSE;
        const float *planes[3] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                                  exr_part_plane(part, "B")};
        const float *sigma = exr_part_plane(part, "sigma");
        struct btf_sigma of;
        const gboolean bars = sigma && btf_sigma_read(part, &of);
        struct products *products = &report->products[k];
        for (int t = 0; t < part->width * part->height; t++)
            for (int c = 0; c < 3; c++) {
                const float exact = truth[t * 3 + c];
                const float relative_error = fabsf(planes[c][t] - exact) / MAX(exact, 0.02f);
                products->differences[left_out] += pow((double)(planes[c][t] - exact), 2);
                products->values[left_out] += (double)exact * (double)exact;
                if (left_out)
                    continue;
                g_array_append_val(view->theta_deg > 60 ? products->steep : products->errors,
                                   relative_error);
                if (!bars || !(sigma[t] > 0))
                    continue;
                const double bar =
                    hypot(of.colour[c] * (double)sigma[t], of.scale[c] * (double)planes[c][t]);
                const double off = fabs((double)(planes[c][t] - exact)) / bar;
                products->n_bars++;
                products->chi2 += off * off;
                products->beyond += off > BEYOND_SIGMA;
            }
        if (k == CALIBRATED && draw && demo_btf_add(report->picture, part, view, light, truth))
            g_printerr("%s: column %d, view from theta %g, phi %g, light from %g, %g degrees\n",
                       btf_png, demo_btf_columns(report->picture), view->theta_deg, view->phi_deg,
                       light->theta_deg, light->phi_deg);
        exr_part_free(part);
    }
    return TRUE;
}

struct btf_pair {
    const struct report *report;
    const struct session_direction *view, *light;
    const struct session_shot *shot;
    float *truth; /* R G B interleaved; NULL where no picture was taken */
};

static void trace_btf_pair(int i, gpointer data) {
    struct btf_pair *pair = (struct btf_pair *)data + i;
    const struct report *report = pair->report;
    if (!pair->shot)
        return;
    pair->truth = g_new(float, (gsize)report->grid.width *(gsize)report->grid.height * 3);
    truth_btf(report->world, pair->view->device, pair->shot->device, pair->shot->turntable_deg,
              pair->shot->arc_deg, &report->texels, TRUTH_SAMPLES, pair->truth);
}

static gboolean measure_btf(struct report *report, GError **error) {
    g_autofree struct btf_pair *pairs = g_new0(struct btf_pair, btf_pairs);
    g_autoptr(GRand) random = g_rand_new_with_seed(4);
    for (int i = 0; i < btf_pairs; i++) {
        struct btf_pair *pair = &pairs[i];
        pair->report = report;
        pair->view = g_ptr_array_index(report->views,
                                       g_rand_int_range(random, 0, (gint32)report->views->len));
        pair->light = g_ptr_array_index(report->lights,
                                        g_rand_int_range(random, 0, (gint32)report->lights->len));
        pair->shot = find_lamp_shot(report, pair->view, pair->light->index);
    }
    work_for_each(0, btf_pairs, trace_btf_pair, pairs);
    gboolean ok = TRUE;
    for (int i = 0; i < btf_pairs; i++) {
        const struct btf_pair *pair = &pairs[i];
        const gboolean left_out = pair->shot && pair->shot->state == SHOT_SKIPPED;
        ok = ok && (!pair->truth ||
                    measure_btf_pair(report, pair->view, pair->light, pair->truth, left_out,
                                     btf_png && !left_out && i % 3 == 0, error));
        g_free(pair->truth);
    }
    return ok && (!btf_png || demo_btf_write(report->picture, btf_png, error));
}

/* What is told of products, in this order. */
enum {
    MDF_RMS_MM,
    MDF_RMS,
    MDF_MEDIAN,
    MDF_WITH_EDGES,
    MDF_OUTLIERS,
    MDF_COVERAGE,
    MDF_SEEN,
    MDF_CHI2,
    MDF_BEYOND,
    BTF_MEDIAN,
    BTF_P95,
    BTF_STEEP_MEDIAN,
    BTF_STEEP_P95,
    BTF_CHI2,
    BTF_BEYOND,
    BTF_RMS,
    BTF_LEFT_OUT_RMS,
    FIGURES
};
static const char *const figure_names[FIGURES] = {
    "mdf_rms_mm",
    "mdf_rms_texels",
    "mdf_median_abs_texels",
    "mdf_rms_with_edges_texels",
    "mdf_outliers",
    "mdf_coverage_of_seen",
    "mdf_seen_of_texels",
    "mdf_chi2",
    "mdf_beyond_3_sigma",
    "btf_relative_error_median",
    "btf_relative_error_p95",
    "btf_relative_error_above_60deg_median",
    "btf_relative_error_above_60deg_p95",
    "btf_chi2",
    "btf_beyond_3_sigma",
    "btf_rms",
    "btf_left_out_rms",
};

static void sum_up(const struct report *report, const struct products *products,
                   double ret[FIGURES]) {
    const double texel_mm = report->grid.width_mm / report->grid.width;
    const struct mdf_sums *sums = &products->sums;
    g_array_sort(sums->errors, floats_by_value);
    g_array_sort(products->errors, floats_by_value);
    g_array_sort(products->steep, floats_by_value);
    ret[MDF_RMS_MM] = sqrt(sums->squares / (double)sums->n);
    ret[MDF_RMS] = ret[MDF_RMS_MM] / texel_mm;
    ret[MDF_MEDIAN] = quantile(sums->errors, 0.5) / texel_mm;
    ret[MDF_WITH_EDGES] = sqrt(sums->squares_all / (double)sums->n_all) / texel_mm;
    ret[MDF_OUTLIERS] = (double)sums->outliers / (double)sums->n_all;
    ret[MDF_COVERAGE] = (double)sums->covered / (double)sums->seen;
    ret[MDF_SEEN] = (double)sums->seen / (double)sums->texels;
    ret[MDF_CHI2] = sums->chi2 / (double)sums->n_bars;
    ret[MDF_BEYOND] = (double)sums->beyond / (double)sums->n_bars;
    ret[BTF_CHI2] = products->chi2 / (double)products->n_bars;
    ret[BTF_BEYOND] = (double)products->beyond / (double)products->n_bars;
    ret[BTF_RMS] = sqrt(products->differences[0] / products->values[0]);
    ret[BTF_LEFT_OUT_RMS] = sqrt(products->differences[1] / products->values[1]);
    ret[BTF_MEDIAN] = quantile(products->errors, 0.5);
    ret[BTF_P95] = quantile(products->errors, 0.95);
    ret[BTF_STEEP_MEDIAN] = quantile(products->steep, 0.5);
    ret[BTF_STEEP_P95] = quantile(products->steep, 0.95);
}

static void add_pair(GString *json, const char *name, double before, double after) {
    g_string_append_printf(json, "%s\n    \"%s\": {", json->str[json->len - 1] == '{' ? "" : ",",
                           name);
    add_value_to(json, "nominal", before);
    g_string_append(json, ", ");
    add_value_to(json, "calibrated", after);
    if (before > 0) {
        g_string_append(json, ", ");
        add_value_to(json, "fell_by", 1 - after / before);
    }
    g_string_append_c(json, '}');
}

static const struct {
    const char *name, *words, *unit;
    gsize at;
    double scale; /* from what is in the report to the unit */
} error_rows[] = {
#define AT(member) G_STRUCT_OFFSET(struct demo_errors, member)
    {"camera_points_rms_px", "where cameras see points of the sample, RMS", "px", AT(camera_px), 1},
    {"camera_direction_deg", "direction of the worst camera", "°", AT(camera_deg), 1},
    {"camera_distance_pct", "distance of the worst camera", "%", AT(camera_pct), 1},
    {"axis_mm", "turntable axis", "mm", AT(axis_mm), 1},
    {"axis_deg", "turntable axis", "°", AT(axis_deg), 1},
    {"lamp_direction_deg", "direction of the worst lamp", "°", AT(lamp_deg), 1},
    {"lamp_distance_pct", "distance of the worst lamp", "%", AT(lamp_pct), 1},
    {"arc_zero_deg", "zero of the arc", "°", AT(arc_zero_deg), 1},
    {"laser_sheet_deg", "worst laser sheet of all steps", "°", AT(sheet_deg), 1},
    {"laser_sheet_mm", "worst laser sheet, within the sample", "mm", AT(sheet_mm), 1},
    {"light_median", "what cameras show of white, median", "%", AT(light_median), 100},
    {"light_worst", "what cameras show of white, worst", "%", AT(light_worst), 100},
#undef AT
};

static const struct {
    int figure;
    const char *words, *unit;
    double scale;
} figure_rows[] = {
    {MDF_RMS_MM, "depths, RMS beside edges", "mm", 1},
    {MDF_MEDIAN, "depths, median", "texels", 1},
    {BTF_MEDIAN, "reflectance, median, views up to 60°", "%", 100},
    {BTF_P95, "reflectance, 95 of 100, views up to 60°", "%", 100},
    {BTF_STEEP_MEDIAN, "reflectance, median, views at 75°", "%", 100},
};

static void tell(const char *words, const char *unit, double scale, double before, double after) {
    const int columns = 44 + (int)strlen(words) - (int)g_utf8_strlen(words, -1);
    g_printerr("  %-*s %9.4g %9.4g %-6s", columns, words, scale * before, scale * after, unit);
    if (before > 0 && after < before)
        g_printerr("  %3.0f %% less", 100 * (1 - after / before));
    g_printerr("\n");
}

/* The calibration's own errors, and those of what was made with it, next to the rig file's. */
static void report_calibration(struct report *report, const double figures[KINDS][FIGURES]) {
    struct demo_errors errors[KINDS];
    g_autoptr(GArray) steps = g_array_new(FALSE, FALSE, sizeof(struct demo_step));
    for (guint i = 0; i < report->shots->len; i++) {
        const struct session_shot *shot = g_ptr_array_index(report->shots, i);
        for (int k = 0; shot->kind == SHOT_SWEEP && k < SHEETS; k++) {
            const double part = (double)k / (SHEETS - 1);
            const struct demo_step step = {shot->device, shot->arc_deg,
                                           (1 - part) * shot->sweep_from_deg +
                                               part * shot->sweep_to_deg};
            g_array_append_val(steps, step);
        }
    }
    for (int k = 0; k < KINDS; k++)
        demo_errors_of(report->world, report->calibrations[k],
                       (const struct demo_step *)(gpointer)steps->data, (int)steps->len,
                       &errors[k]);
    g_printerr("errors against the simulated truth      rig file   calibrated\n");
    g_string_append(report->json, "  \"calibration\": {");
    for (gsize i = 0; i < G_N_ELEMENTS(error_rows); i++) {
        const double before = G_STRUCT_MEMBER(double, &errors[NOMINAL], error_rows[i].at),
                     after = G_STRUCT_MEMBER(double, &errors[CALIBRATED], error_rows[i].at);
        add_pair(report->json, error_rows[i].name, before, after);
        tell(error_rows[i].words, error_rows[i].unit, error_rows[i].scale, before, after);
    }
    g_string_append(report->json, "\n  },\n");
    if (report->n_kinds < KINDS)
        return;
    g_string_append(report->json, "  \"by_calibration\": {");
    for (int i = 0; i < FIGURES; i++)
        add_pair(report->json, figure_names[i], figures[NOMINAL][i], figures[CALIBRATED][i]);
    g_string_append(report->json, "\n  },\n");
    for (gsize i = 0; i < G_N_ELEMENTS(figure_rows); i++)
        tell(figure_rows[i].words, figure_rows[i].unit, figure_rows[i].scale,
             figures[NOMINAL][figure_rows[i].figure], figures[CALIBRATED][figure_rows[i].figure]);
}

static void report_counts(struct report *report) {
    int done = 0;
    for (guint i = 0; i < report->shots->len; i++)
        done += ((struct session_shot *)g_ptr_array_index(report->shots, i))->state == SHOT_DONE;
    g_string_append_printf(report->json,
                           "  \"views\": %u,\n  \"lights\": %u,\n  \"laser_positions\": %u,\n"
                           "  \"texels\": [%d, %d],\n  \"shots\": %u,\n  \"shots_done\": %d,\n",
                           report->views->len, report->lights->len, report->lasers->len,
                           report->grid.width, report->grid.height, report->shots->len, done);
    add_value(report, "frames", "frames");
    add_value(report, "retakes", "retakes");
    add_value(report, "simulated_s", "clock_s");
    add_value(report, "predicted_s", "predicted_s");
    add_value(report, "lower_bound_s", "lower_bound_s");
    add_value(report, "capture_real_s", "real_s");
    add_value(report, "capture_peak_memory_mib", "capture_peak_memory_mib");
    add_value(report, "processing_s", "processing_s");
    add_value(report, "processing_peak_memory_mib", "processing_peak_memory_mib");
    add_value(report, "svd_error", "eigenmaps_error");
}

static gboolean open_products(struct products *products, const char *session, GError **error) {
    products->session = session_open(session, SESSION_READ, error);
    if (!products->session)
        return FALSE;
    g_autofree char *path = session_file(products->session, "products/mdf.exr");
    products->mdf = exr_read(path, error);
    products->sums.errors = g_array_new(FALSE, FALSE, sizeof(float));
    products->errors = g_array_new(FALSE, FALSE, sizeof(float));
    products->steep = g_array_new(FALSE, FALSE, sizeof(float));
    return products->mdf != NULL;
}

static void close_products(struct products *products) {
    GArray **arrays[] = {&products->sums.errors, &products->errors, &products->steep};
    for (gsize i = 0; i < G_N_ELEMENTS(arrays); i++)
        g_clear_pointer(arrays[i], g_array_unref);
    exr_file_free(products->mdf);
    session_close(products->session);
}

static gboolean read_calibrations(struct report *report, const char *path, GError **error) {
    g_autofree char *text = session_text(session_of(report), "calibration.conf", error);
    g_autofree char *rig_conf = session_text(session_of(report), "rig.conf", error);
    struct rig rig;
    if (!text || !rig_conf || !devices_parse_geometry(rig_conf, path, &rig, error))
        return FALSE;
    report->calibrations[NOMINAL] = calibration_new(&rig);
    report->calibrations[CALIBRATED] = calibration_from_text(text, path, error);
    return report->calibrations[CALIBRATED] != NULL;
}

static gboolean open_report(struct report *report, const char *path, const char *world,
                            GError **error) {
    if (!open_products(&report->products[CALIBRATED], path, error) ||
        (nominal && !open_products(&report->products[NOMINAL], nominal, error)))
        return FALSE;
    report->n_kinds = nominal ? KINDS : 1;
    Session *session = session_of(report);
    if (!session_grid(session, &report->grid, error) || !read_calibrations(report, path, error))
        return FALSE;
    report->texels =
        (struct truth_grid){report->grid.width, report->grid.height, report->grid.width_mm,
                            report->grid.height_mm, report->grid.reference_mm};
    report->picture = demo_btf_new(&report->grid);
    return (report->views = session_views(session, error)) &&
           (report->lights = session_lights(session, error)) &&
           (report->lasers = session_lasers(session, error)) &&
           (report->shots = session_shots(session, error)) &&
           (report->world = world_get(world, error));
}

static void close_report(struct report *report) {
    GPtrArray **arrays[] = {&report->views, &report->lights, &report->lasers, &report->shots};
    for (gsize i = 0; i < G_N_ELEMENTS(arrays); i++)
        g_clear_pointer(arrays[i], g_ptr_array_unref);
    for (int k = 0; k < KINDS; k++) {
        calibration_free(report->calibrations[k]);
        close_products(&report->products[k]);
    }
    demo_btf_free(report->picture);
    world_unref(report->world);
    g_string_free(report->json, TRUE);
}

/* As it is: GLib would write ? for ° where the locale has no such sign. */
static void put_err(const char *text) {
    fputs(text, stderr);
}

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GOptionContext) context = g_option_context_new("SESSION WORLD.conf REPORT.json");
    setlocale(LC_ALL, "");
    g_set_printerr_handler(put_err);
    g_option_context_add_main_entries(context, entries, NULL);
    if (!g_option_context_parse(context, &argc, &argv, &error) || argc != 4) {
        fprintf(stderr, "demo_report: %s\n", error ? error->message : "three arguments are needed");
        return 2;
    }
    struct report report = {.json = g_string_new("{\n")};
    gboolean ok = open_report(&report, argv[1], argv[2], &error);
    if (ok) {
        report_counts(&report);
        ok = measure_mdf(&report, &error) && measure_btf(&report, &error);
    }
    if (ok) {
        double figures[KINDS][FIGURES] = {{0}};
        for (int k = 0; k < report.n_kinds; k++)
            sum_up(&report, &report.products[k], figures[k]);
        for (int i = 0; i < FIGURES; i++)
            add_number(report.json, figure_names[i], figures[CALIBRATED][i]);
        report_calibration(&report, figures);
        if (facts)
            g_string_append_printf(report.json, "  %s,\n", facts);
        g_string_truncate(report.json, report.json->len - 2);
        g_string_append(report.json, "\n}\n");
        ok = g_file_set_contents(argv[3], report.json->str, -1, &error);
        fputs(report.json->str, stdout);
    }
    close_report(&report);
    if (!ok)
        fprintf(stderr, "demo_report: %s\n", error->message);
    return ok ? 0 : 1;
}
