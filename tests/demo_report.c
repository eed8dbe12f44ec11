/*
 * How far a captured session is from the truth of the simulated world it was captured in: the
 * figures of demo/report.json, and a picture of one view's MDF beside the truth.
 */
#include "calib/rig.h"
#include "processing/exr.h"
#include "processing/session.h"
#include "sim/truth.h"

#include <math.h>
#include <png.h>
#include <stdio.h>
#include <stdlib.h>

/* A texel, in x and y: edges of shadows need many. */
#define TRUTH_SAMPLES 12

struct report {
    Session *session;
    World *world;
    struct session_grid grid;
    struct truth_grid texels;
    GPtrArray *views, *lights, *lasers, *shots;
    struct rig rig;
    GString *json;
};

static char *mdf_png, *btf_png, *facts;
static int btf_pairs = 120;
static const GOptionEntry entries[] = {
    {"mdf-png", 0, 0, G_OPTION_ARG_FILENAME, &mdf_png, "MDF of one view beside the truth", "PNG"},
    {"btf-png", 0, 0, G_OPTION_ARG_FILENAME, &btf_png, "BTF pictures beside the truth", "PNG"},
    {"btf-pairs", 0, 0, G_OPTION_ARG_INT, &btf_pairs, "How many (view, light) pairs to trace", "N"},
    {"facts", 0, 0, G_OPTION_ARG_STRING, &facts, "More members for the report, as JSON text",
     "TEXT"},
    {NULL},
};

static int compare_floats(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static double quantile(GArray *sorted, double q) {
    return sorted->len == 0 ? NAN : g_array_index(sorted, float, (guint)(q * (sorted->len - 1)));
}

static void add_number(GString *json, const char *name, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(text, sizeof text, "%.6g", value);
    g_string_append_printf(json, "  \"%s\": %s,\n", name, isfinite(value) ? text : "null");
}

static void add_value(struct report *report, const char *name, const char *key) {
    g_autofree char *value = session_value(report->session, key);
    add_number(report->json, name, value ? g_ascii_strtod(value, NULL) : NAN);
}

/* The colours of a height picture, viridis: dark violet is deepest, yellow highest; of equal steps
 * in lightness, so that grey prints show the same. −1, not measured, is grey. */
static void height_colour(float value, float least, float most, guint8 *rgb) {
    static const float stops[5][3] = {
        {68, 1, 84}, {59, 82, 139}, {33, 145, 140}, {94, 201, 98}, {253, 231, 37}};
    if (value < 0) {
        rgb[0] = rgb[1] = rgb[2] = 90;
        return;
    }
    const float t = 4 * CLAMP((most - value) / MAX(most - least, 1e-6f), 0.0f, 1.0f);
    const int i = MIN((int)t, 3);
    for (int c = 0; c < 3; c++)
        rgb[c] = (guint8)(stops[i][c] + (t - i) * (stops[i + 1][c] - stops[i][c]));
}

static void difference_colour(float difference, float most, guint8 *rgb) {
    const float t = CLAMP(difference / most, -1.0f, 1.0f);
    rgb[0] = (guint8)(t < 0 ? 255 + 255 * t : 255);
    rgb[1] = (guint8)(255 - 255 * fabsf(t));
    rgb[2] = (guint8)(t > 0 ? 255 - 255 * t : 255);
}

static gboolean write_png(const char *path, const guint8 *rgb, int width, int height,
                          GError **error) {
    png_image image = {.version = PNG_IMAGE_VERSION,
                       .width = (png_uint_32)width,
                       .height = (png_uint_32)height,
                       .format = PNG_FORMAT_RGB};
    if (png_image_write_to_file(&image, path, 0, rgb, 0, NULL))
        return TRUE;
    g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_IO, "%s: %s", path, image.message);
    return FALSE;
}

static void blow_up(guint8 *picture, int stride, int x0, int y0, int scale, const guint8 *rgb) {
    for (int y = 0; y < scale; y++)
        for (int x = 0; x < scale; x++)
            memcpy(picture + ((gsize)(y0 + y) * stride + x0 + x) * 3, rgb, 3);
}

enum { SCALE = 6, GAP = 8, BAR = 14 };

/* Under each panel a bar of its colours: deepest to highest, and −a quarter of a texel to + one. */
static void paint_bars(guint8 *picture, int stride, int panel, int top, float least, float most) {
    for (int x = 0; x < panel; x++) {
        const float t = (x + 0.5f) / panel;
        guint8 height[3], difference[3];
        height_colour(most + t * (least - most), least, most, height);
        difference_colour(2 * t - 1, 1, difference);
        for (int y = top; y < top + BAR; y++) {
            memcpy(picture + ((gsize)y * stride + x) * 3, height, 3);
            memcpy(picture + ((gsize)y * stride + panel + GAP + x) * 3, height, 3);
            memcpy(picture + ((gsize)y * stride + 2 * (panel + GAP) + x) * 3, difference, 3);
        }
    }
}

/* Three panels: measured, true, measured − true over ± a quarter of a texel. */
static gboolean write_mdf_picture(const struct report *report, const float *measured,
                                  const float *truth, GError **error) {
    const int w = report->grid.width, h = report->grid.height;
    const int width = 3 * w * SCALE + 2 * GAP, height = h * SCALE + GAP + BAR;
    const float span = (float)(0.25 * report->grid.width_mm / w);
    float least = INFINITY, most = 0;
    for (int i = 0; i < w * h; i++) {
        if (truth[i] < 0)
            continue;
        least = MIN(least, truth[i]);
        most = MAX(most, truth[i]);
    }
    g_autofree guint8 *picture = g_malloc((gsize)width * height * 3);
    memset(picture, 40, (gsize)width * height * 3);
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            const float d = measured[y * w + x], t = truth[y * w + x];
            guint8 rgb[3];
            height_colour(d, least, most, rgb);
            blow_up(picture, width, x * SCALE, y * SCALE, SCALE, rgb);
            height_colour(t, least, most, rgb);
            blow_up(picture, width, w * SCALE + GAP + x * SCALE, y * SCALE, SCALE, rgb);
            if (d < 0 || t < 0)
                height_colour(-1, least, most, rgb);
            else
                difference_colour(d - t, span, rgb);
            blow_up(picture, width, 2 * (w * SCALE + GAP) + x * SCALE, y * SCALE, SCALE, rgb);
        }
    paint_bars(picture, width, w * SCALE, h * SCALE + GAP, least, most);
    g_printerr(
        "%s: measured, true, difference; depths along the line of sight from %.2f mm (violet) to "
        "%.2f mm (yellow), differences from %+.2f mm (blue) to %+.2f mm (red); grey: not "
        "measured\n",
        mdf_png, (double)most, (double)least, (double)-span, (double)span);
    return write_png(mdf_png, picture, width, height, error);
}

/* The laser positions that swept a view: those of the sweeps at its turntable angle. */
static int lasers_of_view(const struct report *report, const struct session_direction *view,
                          double *arc_deg, int *laser) {
    int n = 0;
    for (guint i = 0; i < report->shots->len; i++) {
        const struct session_shot *shot = g_ptr_array_index(report->shots, i);
        if (shot->kind != SHOT_SWEEP || shot->state != SHOT_DONE ||
            !(shot->cameras & (1u << view->device)) ||
            fabs(shot->turntable_deg - view->turntable_deg) > 1e-6)
            continue;
        arc_deg[n] = shot->arc_deg;
        laser[n++] = shot->device;
    }
    return n;
}

struct mdf_sums {
    double squares, squares_all;
    gint64 n, n_all, covered, seen, outliers, texels;
    GArray *errors;
};

static void add_mdf_view(struct mdf_sums *sums, const float *measured, const float *truth,
                         const guint8 *edge, const guint8 *seen, int n, double texel_mm) {
    for (int i = 0; i < n; i++) {
        sums->texels++;
        sums->seen += seen[i] > 0;
        sums->covered += seen[i] > 0 && measured[i] >= 0;
        if (measured[i] < 0)
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
    }
}

static gboolean report_mdf(struct report *report, GError **error) {
    g_autofree char *path = session_file(report->session, "products/mdf.exr");
    struct exr_file *mdf = exr_read(path, error);
    if (!mdf)
        return FALSE;
    const int n = report->grid.width * report->grid.height;
    const double texel_mm = report->grid.width_mm / report->grid.width;
    g_autofree float *truth = g_new(float, n);
    g_autofree guint8 *edge = g_new(guint8, n), *seen = g_new(guint8, n);
    g_autofree double *arc_deg = g_new(double, report->shots->len);
    g_autofree int *laser = g_new(int, report->shots->len);
    struct mdf_sums sums = {.errors = g_array_new(FALSE, FALSE, sizeof(float))};
    gboolean ok = TRUE;
    for (guint v = 0; ok && v < report->views->len; v++) {
        const struct session_direction *view = g_ptr_array_index(report->views, v);
        g_autofree char *name = g_strdup_printf("view_%04d", view->index);
        const struct exr_part *part = exr_file_part(mdf, name);
        const float *measured = part ? exr_part_plane(part, "D") : NULL;
        if (!measured)
            continue;
        truth_mdf(report->world, view->device, view->turntable_deg, &report->texels, truth, edge);
        const int n_lasers = lasers_of_view(report, view, arc_deg, laser);
        truth_laser_seen(report->world, view->device, view->turntable_deg, &report->texels, arc_deg,
                         laser, n_lasers, seen);
        add_mdf_view(&sums, measured, truth, edge, seen, n, texel_mm);
        if (mdf_png && v == report->views->len * 2 / 5)
            ok = write_mdf_picture(report, measured, truth, error);
    }
    g_array_sort(sums.errors, compare_floats);
    add_number(report->json, "mdf_rms_mm", sqrt(sums.squares / sums.n));
    add_number(report->json, "mdf_rms_texels", sqrt(sums.squares / sums.n) / texel_mm);
    add_number(report->json, "mdf_median_abs_texels", quantile(sums.errors, 0.5) / texel_mm);
    add_number(report->json, "mdf_rms_with_edges_texels",
               sqrt(sums.squares_all / sums.n_all) / texel_mm);
    add_number(report->json, "mdf_outliers", (double)sums.outliers / sums.n_all);
    add_number(report->json, "mdf_coverage_of_seen", (double)sums.covered / sums.seen);
    add_number(report->json, "mdf_seen_of_texels", (double)sums.seen / sums.texels);
    g_array_unref(sums.errors);
    exr_file_free(mdf);
    return ok;
}

static const struct session_shot *find_lamp_shot(const struct report *report,
                                                 const struct session_direction *view, int light) {
    for (guint i = 0; i < report->shots->len; i++) {
        const struct session_shot *shot = g_ptr_array_index(report->shots, i);
        if (shot->kind == SHOT_LAMP && shot->state == SHOT_DONE && shot->source == light &&
            (shot->cameras & (1u << view->device)) &&
            fabs(shot->turntable_deg - view->turntable_deg) < 1e-6)
            return shot;
    }
    return NULL;
}

static guint8 to_srgb(float value) {
    const float v = CLAMP(value, 0.0f, 1.0f);
    return (guint8)(255 * (v <= 0.0031308f ? 12.92f * v : 1.055f * powf(v, 1 / 2.4f) - 0.055f) +
                    0.5f);
}

/* One column a pair: measured, true, and four times the difference around grey. */
static void paint_btf_pair(guint8 *picture, int stride, int column, const struct report *report,
                           const struct exr_part *part, const float *truth) {
    const float *planes[3] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                              exr_part_plane(part, "B")};
    const int w = report->grid.width, h = report->grid.height, scale = SCALE / 2;
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            guint8 measured[3], exact[3], difference[3];
            for (int c = 0; c < 3; c++) {
                const float is = planes[c][y * w + x], should = truth[(y * w + x) * 3 + c];
                measured[c] = to_srgb(is);
                exact[c] = to_srgb(should);
                difference[c] = (guint8)CLAMP(127.5f + 4 * 255 * (is - should), 0.0f, 255.0f);
            }
            const int left = column * (w * scale + GAP) + x * scale;
            blow_up(picture, stride, left, y * scale, scale, measured);
            blow_up(picture, stride, left, h * scale + GAP + y * scale, scale, exact);
            blow_up(picture, stride, left, 2 * (h * scale + GAP) + y * scale, scale, difference);
        }
}

enum { COLUMNS = 6 };

static gboolean report_btf(struct report *report, GError **error) {
    const int w = report->grid.width, h = report->grid.height, n = w * h;
    const int scale = SCALE / 2, width = COLUMNS * (w * scale + GAP) - GAP,
              height = 3 * (h * scale + GAP) - GAP;
    g_autofree float *truth = g_new(float, (gsize)n * 3);
    g_autofree guint8 *picture = g_malloc0((gsize)width * height * 3);
    g_autoptr(GRand) random = g_rand_new_with_seed(4);
    GArray *errors = g_array_new(FALSE, FALSE, sizeof(float));
    GArray *steep = g_array_new(FALSE, FALSE, sizeof(float));
    int column = 0;
    gboolean ok = TRUE;
    for (int i = 0; ok && i < btf_pairs; i++) {
        const struct session_direction *view = g_ptr_array_index(
            report->views, g_rand_int_range(random, 0, (gint32)report->views->len));
        const struct session_direction *light = g_ptr_array_index(
            report->lights, g_rand_int_range(random, 0, (gint32)report->lights->len));
        const struct session_shot *shot = find_lamp_shot(report, view, light->index);
        if (!shot)
            continue;
        g_autofree char *relative = g_strdup_printf("products/btf/view_%04d.exr", view->index);
        g_autofree char *path = session_file(report->session, relative);
        g_autofree char *name = g_strdup_printf("light_%04d", light->index);
        struct exr_part *part = exr_read_part(path, name, error);
        if (!part) {
            ok = FALSE;
            break;
        }
        truth_btf(report->world, view->device, shot->device, shot->turntable_deg, shot->arc_deg,
                  &report->texels, TRUTH_SAMPLES, truth);
        const float *planes[3] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                                  exr_part_plane(part, "B")};
        for (int t = 0; t < n; t++)
            for (int c = 0; c < 3; c++) {
                const float exact = truth[t * 3 + c];
                const float relative_error = fabsf(planes[c][t] - exact) / MAX(exact, 0.02f);
                g_array_append_val(view->theta_deg > 60 ? steep : errors, relative_error);
            }
        if (btf_png && column < COLUMNS && i % 3 == 0) {
            g_printerr("%s: column %d, view from theta %g, phi %g, light from %g, %g degrees\n",
                       btf_png, column + 1, view->theta_deg, view->phi_deg, light->theta_deg,
                       light->phi_deg);
            paint_btf_pair(picture, width, column++, report, part, truth);
        }
        exr_part_free(part);
    }
    g_array_sort(errors, compare_floats);
    g_array_sort(steep, compare_floats);
    add_number(report->json, "btf_relative_error_median", quantile(errors, 0.5));
    add_number(report->json, "btf_relative_error_p95", quantile(errors, 0.95));
    add_number(report->json, "btf_relative_error_above_60deg_median", quantile(steep, 0.5));
    add_number(report->json, "btf_relative_error_above_60deg_p95", quantile(steep, 0.95));
    g_array_unref(errors);
    g_array_unref(steep);
    return ok && (!btf_png || write_png(btf_png, picture, width, height, error));
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

static gboolean open_report(struct report *report, const char *session, const char *world,
                            GError **error) {
    report->session = session_open(session, SESSION_READ, error);
    if (!report->session || !session_grid(report->session, &report->grid, error))
        return FALSE;
    report->texels =
        (struct truth_grid){report->grid.width, report->grid.height, report->grid.width_mm,
                            report->grid.height_mm, report->grid.reference_mm};
    g_autofree char *text = session_text(report->session, "calibration.conf", error);
    return text && rig_from_text(&report->rig, text, session, error) &&
           (report->views = session_views(report->session, error)) &&
           (report->lights = session_lights(report->session, error)) &&
           (report->lasers = session_lasers(report->session, error)) &&
           (report->shots = session_shots(report->session, error)) &&
           (report->world = world_get(world, error));
}

static void close_report(struct report *report) {
    GPtrArray **arrays[] = {&report->views, &report->lights, &report->lasers, &report->shots};
    for (gsize i = 0; i < G_N_ELEMENTS(arrays); i++)
        g_clear_pointer(arrays[i], g_ptr_array_unref);
    world_unref(report->world);
    session_close(report->session);
    g_string_free(report->json, TRUE);
}

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GOptionContext) context = g_option_context_new("SESSION WORLD.conf REPORT.json");
    g_option_context_add_main_entries(context, entries, NULL);
    if (!g_option_context_parse(context, &argc, &argv, &error) || argc != 4) {
        fprintf(stderr, "demo_report: %s\n", error ? error->message : "three arguments are needed");
        return 2;
    }
    struct report report = {.json = g_string_new("{\n")};
    gboolean ok = open_report(&report, argv[1], argv[2], &error);
    if (ok) {
        report_counts(&report);
        ok = report_mdf(&report, &error) && report_btf(&report, &error);
    }
    if (ok) {
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
