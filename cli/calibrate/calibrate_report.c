/* calibrate report: shows a calibration file as an HTML page. */
#include "calibrate.h"
#include "calibrate_tables.h"

#include <string.h>

#define DEG(rad) ((rad) * (180 / G_PI))
#define PLOT     320 /* size of a plot on the page, in px */

#define MAX_SHOWN 5 /* maximum number of rejected pictures that are listed for a part */

static char *output_option;
static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option, "Write the page here", "FILE.html"},
    {NULL},
};

/* The beginning of the HTML page. Numbers in the page have decimal points, because the programs set
 * no numeric locale. */
static const char head[] =
    "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\n"
    "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
    "<meta name=\"color-scheme\" content=\"light dark\"><title>Calibration</title>\n<style>\n"
    ":root{--ink:#1d2126;--faint:#5c6570;--line:#d9dde2;--back:#fff;--good:#1a7f4b;"
    "--doubt:#9a6200}\n"
    "@media (prefers-color-scheme:dark){:root{--ink:#e6e8eb;--faint:#9aa3ad;--line:#3a4047;"
    "--back:#17191c;--good:#56c48a;--doubt:#e3ab4d}}\n"
    "body{font:15px/1.5 system-ui,sans-serif;color:var(--ink);background:var(--back);"
    "max-width:72em;margin:2em auto;padding:0 1em}\n"
    ".wide{overflow-x:auto}table{border-collapse:collapse;margin:1em 0}\n"
    "table{font-size:14px}td,th{padding:.2em .6em;text-align:right;border-bottom:1px solid "
    "var(--line)}\n"
    "td{white-space:nowrap}td.text{white-space:normal;min-width:12em;overflow-wrap:anywhere}\n"
    "td:first-child,th:first-child,.text{text-align:left;padding-left:0}\n"
    "li,p{overflow-wrap:anywhere}.none,figcaption{color:var(--faint)}\n"
    ".good{color:var(--good)}.doubt{color:var(--doubt)}.good,.doubt{font-weight:600}\n"
    "figure{display:inline-block;margin:0 1em 1em 0;max-width:100%}figcaption{font-size:13px;"
    "max-width:48em}\n"
    "svg{background:#fafafa;border:1px solid var(--line);max-width:100%;height:auto}\n"
    "@media print{body{font-size:10px;margin:0}td,th{padding:.2em .4em}}\n</style></head><body>\n";

static char *escaped(const char *text) {
    return g_markup_escape_text(text, -1);
}

/* Appends the reasons to doubt a part, which a user should check before relying on the part. */
static void doubt_part(GPtrArray *to, const struct calibration *calibration,
                       enum calibration_kind kind) {
    const struct calibration_part *part = &calibration->parts[kind];
    const char *name = calibration_part_name(kind);
    if (!part->done) {
        g_ptr_array_add(
            to, g_strdup_printf("%s: not calibrated, the values of the rig file are used", name));
        return;
    }
    if (calibrate_left_out_most(part, kind))
        g_ptr_array_add(to, g_strdup_printf("%s: more %s were left out (%u) than used, of %d "
                                            "pictures",
                                            name, calibrate_left_out(kind), part->rejected->len,
                                            part->pictures));
    g_auto(GStrv) lacking = calibrate_lacking(calibration, name);
    for (int i = 0; lacking && lacking[i]; i++)
        g_ptr_array_add(to, g_strdup_printf("%s: calibrated from a session that lacks shots: %s",
                                            name, lacking[i]));
    if (part->degrees_of_freedom < 1)
        g_ptr_array_add(
            to,
            g_strdup_printf("%s: nothing was measured twice, so the errors are not known", name));
}

static void doubt_linearity(GPtrArray *to, const struct calibration *calibration) {
    for (int c = 0; c < calibration->rig.n_cameras; c++) {
        const struct transfer *t = &calibration->noise[c].transfer;
        if (calibration->noise[c].known && t->linearity > CALIBRATE_LINEAR)
            g_ptr_array_add(to,
                            g_strdup_printf("camera %s is %.1f %% off linear: switch off its "
                                            "gamma",
                                            calibration->rig.cameras[c].name, 100 * t->linearity));
    }
}

static void add_verdict(GString *to, const struct calibration *calibration) {
    const struct rig *rig = &calibration->rig;
    const gboolean has[CALIBRATION_PARTS] = {TRUE, rig->n_lamps > 0, rig->n_lasers > 0,
                                             rig->n_lamps > 0};
    g_autoptr(GPtrArray) doubts = g_ptr_array_new_with_free_func(g_free);
    int done = 0, all = 0;
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        if (!has[i])
            continue;
        doubt_part(doubts, calibration, (enum calibration_kind)i);
        done += calibration->parts[i].done;
        all++;
    }
    doubt_linearity(doubts, calibration);
    if (doubts->len == 0) {
        g_string_append(to, "<p class=\"good\">Everything is calibrated, and there are no warnings."
                            "</p>\n");
        return;
    }
    g_string_append_printf(
        to, "<p class=\"doubt\">Calibrated: %d of %d. To be looked at:</p>\n<ul>\n", done, all);
    for (guint i = 0; i < doubts->len; i++) {
        g_autofree char *text = escaped(doubts->pdata[i]);
        g_string_append_printf(to, "<li>%s</li>\n", text);
    }
    g_string_append(to, "</ul>\n");
}

static void add_parts(GString *to, const struct calibration *calibration) {
    g_string_append_printf(to, "<div "
                               "class=\"wide\"><table><tr><th>part</th><th>date</th><th>method</"
                               "th><th>pictures</th><th>left out</th>"
                               "<th>residual RMS</th><th>degrees of freedom</th></tr>\n");
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        const struct calibration_part *part = &calibration->parts[i];
        const char *name = calibration_part_name((enum calibration_kind)i);
        if (!part->done) {
            g_string_append_printf(to,
                                   "<tr class=\"none\"><td>%s</td><td colspan=\"6\">not "
                                   "calibrated: nominal</td></tr>\n",
                                   name);
            continue;
        }
        g_autofree char *method = escaped(part->method);
        g_autofree char *unit = escaped(part->residual_unit);
        g_string_append_printf(
            to,
            "<tr><td>%s</td><td>%s</td><td class=\"text\">%s</td><td>%d</td><td>%u %s</td><td>%.3g "
            "%s</td><td>%d</td></tr>\n",
            name, part->date, method, part->pictures, part->rejected->len,
            calibrate_left_out((enum calibration_kind)i), part->residual_rms, unit,
            part->degrees_of_freedom);
    }
    g_string_append_printf(to, "</table></div>\n");
}

static double sigma(const struct calibration_camera *camera, int parameter) {
    return sqrt(camera->covariance[parameter][parameter]);
}

static void add_cameras(GString *to, const struct calibration *calibration) {
    const struct rig *rig = &calibration->rig;
    g_string_append_printf(to,
                           "<h2>Cameras</h2>\n<div class=\"wide\"><table><tr><th>camera</th><th>x, "
                           "y, z (mm)</th><th>from the zenith, "
                           "azimuth (°)</th><th>focal length (px)</th><th>centre "
                           "(px)</th><th>lens</th><th>k1</th><th>corners</th>"
                           "<th>RMS (px)</th></tr>\n");
    for (int i = 0; i < rig->n_cameras; i++) {
        const struct rig_camera *c = &rig->cameras[i];
        const struct calibration_camera *e = &calibration->cameras[i];
        const struct vec3 at = rig_camera_centre_mm(c);
        g_autofree char *name = escaped(c->name);
        double theta, phi;
        rig_angles(at, &theta, &phi);
        phi = phi > G_PI ? phi - 2 * G_PI : phi;
        g_string_append_printf(
            to,
            "<tr><td>%s</td><td>%.2f, %.2f, %.2f</td><td>%.3f, %.3f</td><td>%.2f ± %.2f</td><td>"
            "%.1f ± %.1f, %.1f ± %.1f</td><td>%s</td><td>%.4f ± "
            "%.4f</td><td>%d</td><td>%.3f</td></tr>\n",
            name, at.x, at.y, at.z, DEG(theta), DEG(phi), c->fx_px, sigma(e, CALIBRATION_FX),
            c->cx_px, sigma(e, CALIBRATION_CX), c->cy_px, sigma(e, CALIBRATION_CY),
            rig_lens_name((enum rig_lens)c->lens), c->k1, sigma(e, CALIBRATION_K1), e->points,
            e->residual_rms_px);
    }
    g_string_append_printf(to, "</table></div>\n");
}

/* A drawing of the rig from the side (x, z) or from above (x, y), with the arc at 0. */
struct plan {
    /* Scale in px per mm, and the position of the drawing's top left corner. */
    double scale, left_mm, top_mm;
    gboolean above;
};

static void add_mark(GString *to, const struct plan *plan, struct vec3 at, const char *colour,
                     const char *name, gboolean left) {
    const double x = (at.x - plan->left_mm) * plan->scale;
    const double y = (plan->top_mm - (plan->above ? at.y : at.z)) * plan->scale;
    g_string_append_printf(to, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"4\" fill=\"%s\"/>\n", x, y,
                           colour);
    if (plan->above)
        /* A view from above has no labels, because labels of devices above one another would
         * overlap. */
        return;
    g_autofree char *text = escaped(name);
    g_string_append_printf(
        to, "<text x=\"%.1f\" y=\"%.1f\" font-size=\"10\" text-anchor=\"%s\">%s</text>\n",
        left ? x - 6 : x + 6, y + 3, left ? "end" : "start", text);
}

static void stretch(double range[2], double value) {
    range[0] = MIN(range[0], value);
    range[1] = MAX(range[1], value);
}

/* Chooses the scale so that all devices, their names and a turntable with a radius of 150 mm fit
 * in. */
static void fit_plan(struct plan *plan, const struct rig *rig) {
    double x[2] = {-150, 150}, y[2] = {plan->above ? -150 : -20, plan->above ? 150 : 20};
    for (int i = 0; i < rig->n_cameras + rig->n_lamps + rig->n_lasers; i++) {
        const int lamp = i - rig->n_cameras, laser = lamp - rig->n_lamps;
        const struct vec3 at = lamp < 0    ? rig_camera_centre_mm(&rig->cameras[i])
                               : laser < 0 ? rig->lamps[lamp].position_mm
                                           : rig->lasers[laser].position_mm;
        stretch(x, at.x);
        stretch(y, plan->above ? at.y : at.z);
    }
    const double across = MAX(x[1] - x[0], y[1] - y[0]);
    plan->scale = (PLOT - 80) / MAX(across, 1.0);
    plan->left_mm = (x[0] + x[1]) / 2 - PLOT / plan->scale / 2;
    plan->top_mm = (y[0] + y[1]) / 2 + PLOT / plan->scale / 2;
}

static void add_plan(GString *to, const struct rig *rig, gboolean above) {
    struct plan plan = {.above = above};
    fit_plan(&plan, rig);
    const double x = -plan.left_mm * plan.scale, y = plan.top_mm * plan.scale;
    g_string_append_printf(to, "<figure><svg width=\"%d\" height=\"%d\" viewBox=\"0 0 %d %d\">\n",
                           PLOT, PLOT, PLOT, PLOT);
    if (above)
        g_string_append_printf(to, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%.1f\" fill=\"#ddd\"/>\n",
                               x, y, 150 * plan.scale);
    else
        g_string_append_printf(to,
                               "<path d=\"M%.1f %.1fh%.1f\" stroke=\"#999\" stroke-width=\"3\"/>\n",
                               x - 150 * plan.scale, y, 300 * plan.scale);
    for (int i = 0; i < rig->n_cameras; i++)
        add_mark(to, &plan, rig_camera_centre_mm(&rig->cameras[i]), "#1764ab", rig->cameras[i].name,
                 FALSE);
    for (int i = 0; i < rig->n_lamps; i++)
        add_mark(to, &plan, rig->lamps[i].position_mm, "#e2a100", rig->lamps[i].name, FALSE);
    for (int i = 0; i < rig->n_lasers; i++)
        add_mark(to, &plan, rig->lasers[i].position_mm, "#c0222b", rig->lasers[i].name, TRUE);
    g_string_append_printf(to, "</svg><figcaption>%s; %.0f mm across</figcaption></figure>\n",
                           above ? "from above: x to the right, y up"
                                 : "from the side: x to the right, z up",
                           PLOT / plan.scale);
}

/* Returns a column of a table that calibrate_keep() has kept. *n is reduced to the column's
 * length if the column is shorter. If there is no such column, returns NULL and sets *n to 0. */
static double *report_column(const struct calibration *calibration, const char *group,
                             const char *key, gsize *n) {
    gsize length = 0;
    double *values = g_key_file_get_double_list(calibration->extra, group, key, &length, NULL);
    *n = values ? MIN(*n, length) : 0;
    return values;
}

/* Adds the residuals of a camera as arrows. The RMS residual is drawn as an arrow of 8 pixels of
 * the page. */
static void add_vectors(GString *to, const struct calibration *calibration, int camera) {
    const struct rig_camera *c = &calibration->rig.cameras[camera];
    const struct calibration_camera *e = &calibration->cameras[camera];
    g_autofree char *group = g_strdup_printf("camera residuals %d", camera);
    g_autofree char *name = escaped(c->name);
    gsize n = G_MAXSIZE;
    g_autofree double *x = report_column(calibration, group, "x_px", &n),
                      *y = report_column(calibration, group, "y_px", &n),
                      *dx = report_column(calibration, group, "dx_px", &n),
                      *dy = report_column(calibration, group, "dy_px", &n);
    const double scale = (double)PLOT / c->width;
    const double arrow = e->residual_rms_px > 0 ? 8 / e->residual_rms_px : 1;
    if (n == 0)
        return;
    g_string_append_printf(
        to,
        "<figure><svg width=\"%d\" height=\"%.0f\" viewBox=\"0 0 %d %.0f\"><path "
        "stroke=\"#1764ab\" fill=\"none\" d=\"",
        PLOT, c->height * scale, PLOT, c->height * scale);
    for (gsize i = 0; i < n; i++)
        g_string_append_printf(to, "M%.1f %.1fl%.1f %.1f", x[i] * scale, y[i] * scale,
                               dx[i] * arrow, dy[i] * arrow);
    g_string_append_printf(
        to,
        "\"/></svg><figcaption>%s: %.3f px RMS, drawn %.0f times as long</figcaption></figure>\n",
        name, e->residual_rms_px, arrow / scale);
}

/* Begins a diagram of deviations over a turn of the turntable or over time, with a line at zero in
 * the middle. */
static void begin_diagram(GString *to, const char *title) {
    g_string_append_printf(to,
                           "<h2>%s</h2>\n<figure><svg width=\"%d\" height=\"160\" viewBox=\"0 0 "
                           "%d 160\"><path d=\"M0 80h%d\" stroke=\"#999\"/>\n",
                           title, 2 * PLOT, 2 * PLOT, 2 * PLOT);
}

/* Adds a dot to a diagram. across is 0 … 1, up is −1 … 1. */
static void add_dot(GString *to, double across, double up, double radius, const char *colour) {
    g_string_append_printf(to, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"%g\" fill=\"%s\"/>\n",
                           8 + across * (2 * PLOT - 16), 80 - 72 * up, radius, colour);
}

static void add_turntable(GString *to, const struct calibration *calibration) {
    gsize n = G_MAXSIZE;
    g_autofree double *at = report_column(calibration, "turntable", "commanded_deg", &n),
                      *error = report_column(calibration, "turntable", "error_deg", &n);
    double most = 1e-4;
    for (gsize i = 0; i < n; i++)
        most = MAX(most, fabs(error[i]));
    if (n == 0)
        return;
    begin_diagram(to, "Turntable");
    for (gsize i = 0; i < n; i++)
        add_dot(to, (at[i] - 360 * floor(at[i] / 360)) / 360, error[i] / most, 3, "#1764ab");
    g_string_append_printf(
        to,
        "</svg><figcaption>true minus commanded angle, over a turn; the full height "
        "is ± %.4f°</figcaption></figure>\n",
        most);
}

static void add_drift(GString *to, const struct calibration *calibration) {
    const struct rig *rig = &calibration->rig;
    gsize n = G_MAXSIZE;
    g_autofree double *taken_s = report_column(calibration, "lamp drift", "taken_s", &n),
                      *lamp = report_column(calibration, "lamp drift", "lamp", &n),
                      *output = report_column(calibration, "lamp drift", "output", &n);
    g_autoptr(GString) names = g_string_new(NULL);
    double last_s = 1, most = 1e-4;
    for (gsize i = 0; i < n; i++) {
        last_s = MAX(last_s, taken_s[i]);
        most = MAX(most, fabs(output[i] - 1));
    }
    if (n == 0)
        return;
    begin_diagram(to, "Drift of the lamps");
    for (int l = 0; l < rig->n_lamps; l++) {
        /* The lamps' hues are spread around the colour wheel. */
        g_autofree char *colour = g_strdup_printf("hsl(%d,65%%,45%%)", 360 * l / rig->n_lamps);
        g_autofree char *name = escaped(rig->lamps[l].name);
        g_string_append_printf(names, " <span style=\"color:%s\">%s</span>", colour, name);
        for (gsize i = 0; i < n; i++)
            if (lamp[i] == l)
                add_dot(to, taken_s[i] / last_s, (output[i] - 1) / most, 2.5, colour);
    }
    g_string_append_printf(to,
                           "</svg><figcaption>output of each lamp relative to its mean, while the "
                           "tile was captured, over %.1f "
                           "minutes; the full height is ± %.2f %%:%s</figcaption></figure>\n",
                           last_s / 60, 100 * most, names->str);
}

static void add_rejected(GString *to, const struct calibration *calibration, const char *path) {
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        const GPtrArray *rejected = calibration->parts[i].rejected;
        if (rejected->len == 0)
            continue;
        g_string_append_printf(to, "<h2>Left out: %s</h2>\n<p>%u %s%s</p>\n<ul>\n",
                               calibration_part_name((enum calibration_kind)i), rejected->len,
                               calibrate_left_out((enum calibration_kind)i),
                               rejected->len > MAX_SHOWN ? "; the first are" : "");
        for (guint k = 0; k < MIN(rejected->len, MAX_SHOWN); k++) {
            g_autofree char *text = escaped(rejected->pdata[k]);
            g_string_append_printf(to, "<li>%s</li>\n", text);
        }
        g_string_append(to, "</ul>\n");
        if (rejected->len > MAX_SHOWN) {
            g_autofree char *file = escaped(path);
            g_string_append_printf(to, "<p>mesorig calibrate show --all %s lists all.</p>\n", file);
        }
    }
}

static char *page(const struct calibration *calibration, const char *path) {
    GString *to = g_string_new(head);
    g_autofree char *id = escaped(calibration->rig.id);
    g_string_append_printf(to, "<h1>Calibration of rig %s</h1>\n", id);
    add_verdict(to, calibration);
    add_parts(to, calibration);
    add_cameras(to, calibration);
    calibrate_table_lamps(to, calibration);
    calibrate_table_lasers(to, calibration);
    calibrate_table_light(to, calibration);
    g_string_append(to, "<h2>Positions</h2>\n<p>Cameras blue, lamps yellow, lasers red; lamps and "
                        "lasers with the arc at 0°.</p>\n");
    add_plan(to, &calibration->rig, FALSE);
    add_plan(to, &calibration->rig, TRUE);
    if (calibration->parts[CALIBRATION_CAMERAS].done)
        g_string_append(to, "<h2>Residuals</h2>\n<p>Each arrow leads from a measured corner to its "
                            "predicted place. A pattern in the arrows is an error of the lens "
                            "model; noise shows no pattern.</p>\n");
    for (int i = 0; calibration->parts[CALIBRATION_CAMERAS].done && i < calibration->rig.n_cameras;
         i++)
        add_vectors(to, calibration, i);
    add_turntable(to, calibration);
    add_drift(to, calibration);
    add_rejected(to, calibration, path);
    g_string_append_printf(to, "</body></html>\n");
    return g_string_free(to, FALSE);
}

static int run(const struct call *call, GError **error) {
    if (!output_option)
        return cli_usage(call->command, "no page to write is given: give -o FILE.html");
    g_autoptr(OutputFile) to = cli_output(output_option, "calibration report", error);
    g_autoptr(Calibration) calibration = to ? calibration_read(call->arguments[0], error) : NULL;
    g_autofree char *text = calibration ? page(calibration, call->arguments[0]) : NULL;
    if (!text || !output_file_put(to, text, strlen(text), error))
        return CLI_FAILED;
    record_say(call->record, "%s{file}: look at it in a browser\n", output_option);
    cli_tell_output(call->record, to);
    return CLI_DONE;
}

const struct command calibrate_report = {
    .name = "calibrate report",
    .arguments = "FILE -o FILE.html",
    .examples = "  mesorig calibrate report rig.calibration -o rig.html\n",
    .help = "Show a calibration file as an HTML page.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
