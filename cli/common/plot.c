#include "plot.h"

#include <cairo-svg.h>
#include <gio/gio.h>
#include <math.h>

static gboolean is_svg(const char *path) {
    return g_str_has_suffix(path, ".svg");
}

cairo_t *plot_new(const char *path, GError **error) {
    if (!is_svg(path) && !g_str_has_suffix(path, ".png")) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "%s: the name of a plot must end in .png or .svg", path);
        return NULL;
    }
    cairo_surface_t *surface =
        is_svg(path) ? cairo_svg_surface_create(path, PLOT_WIDTH, PLOT_HEIGHT)
                     : cairo_image_surface_create(CAIRO_FORMAT_RGB24, PLOT_WIDTH, PLOT_HEIGHT);
    cairo_t *cr = cairo_create(surface);
    cairo_surface_destroy(surface);
    cairo_set_source_rgb(cr, 1, 1, 1);
    cairo_paint(cr);
    cairo_select_font_face(cr, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(cr, PLOT_TEXT);
    plot_ink(cr);
    return cr;
}

gboolean plot_finish(cairo_t *cr, const char *path, GError **error) {
    cairo_surface_t *surface = cairo_surface_reference(cairo_get_target(cr));
    cairo_status_t status = cairo_status(cr);
    cairo_destroy(cr);
    if (!status && !is_svg(path))
        status = cairo_surface_write_to_png(surface, path);
    cairo_surface_finish(surface);
    status = status ? status : cairo_surface_status(surface);
    cairo_surface_destroy(surface);
    if (status)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED,
                    "%s: cannot be written: %s; check that the folder has space", path,
                    cairo_status_to_string(status));
    return status == CAIRO_STATUS_SUCCESS;
}

void plot_ink(cairo_t *cr) {
    cairo_set_source_rgb(cr, 0.13, 0.14, 0.16);
}

/* The colours of Okabe and Ito, without yellow, which is not visible on white. Black, grey and
 * other colours follow them. */
void plot_colour(cairo_t *cr, int i) {
    static const double colours[][3] = {{0.00, 0.45, 0.70}, {0.84, 0.37, 0.00}, {0.00, 0.62, 0.45},
                                        {0.80, 0.47, 0.65}, {0.34, 0.71, 0.91}, {0.90, 0.62, 0.00},
                                        {0.35, 0.35, 0.38}, {0.55, 0.20, 0.10}, {0.00, 0.00, 0.00},
                                        {0.55, 0.55, 0.10}, {0.45, 0.20, 0.60}, {0.95, 0.45, 0.55}};
    const double *c = colours[i % (int)G_N_ELEMENTS(colours)];
    cairo_set_source_rgb(cr, c[0], c[1], c[2]);
}

void plot_text(cairo_t *cr, double x, double y, double align, const char *text) {
    cairo_text_extents_t size;
    cairo_text_extents(cr, text, &size);
    cairo_move_to(cr, x - align * size.x_advance, y);
    cairo_show_text(cr, text);
    /* Otherwise a line would connect the end of this path to the next element. */
    cairo_new_path(cr);
}

void plot_title(cairo_t *cr, double x, double y, const char *title, const char *text) {
    cairo_set_font_size(cr, 24);
    plot_text(cr, x, y, 0, title);
    cairo_set_font_size(cr, PLOT_TEXT);
    if (text)
        plot_text(cr, x, y + 32, 0, text);
}

#define DISC_Y      430.0
#define DISC_RADIUS 270.0
#define BAR_X       390.0
#define BAR_Y       760.0
#define BAR_WIDTH   500.0

/* Sets the colour t of a scale from dark blue (t = 0) to yellow (t = 1). Lightness increases evenly
 * with t. */
static void set_heat(cairo_t *cr, double t) {
    static const double stops[6][3] = {{0.27, 0.00, 0.33}, {0.25, 0.27, 0.53}, {0.16, 0.47, 0.56},
                                       {0.13, 0.66, 0.52}, {0.48, 0.82, 0.32}, {0.99, 0.91, 0.14}};
    const double at = CLAMP(t, 0, 1) * 5;
    const int i = MIN((int)at, 4);
    double c[3];
    for (int k = 0; k < 3; k++)
        c[k] = stops[i][k] + (at - i) * (stops[i + 1][k] - stops[i][k]);
    cairo_set_source_rgb(cr, c[0], c[1], c[2]);
}

/* Draws the hemisphere seen from above, with a dot for each direction. The colour of a dot is its
 * error relative to `most`. The dots are as large as the space allows. */
static void draw_disc(cairo_t *cr, double centre, const char *title, const float *theta_deg,
                      const float *phi_deg, const struct compare_sums *sums, int n, double most) {
    const double radius = CLAMP(DISC_RADIUS / sqrt(6.0 * n), 3, 18);
    plot_text(cr, centre, DISC_Y - DISC_RADIUS - 22, 0.5, title);
    cairo_set_line_width(cr, 1);
    for (int theta = 30; theta <= 90; theta += 30) {
        g_autofree char *text = g_strdup_printf("%d°", theta);
        cairo_set_source_rgb(cr, 0.82, 0.83, 0.85);
        cairo_arc(cr, centre, DISC_Y, DISC_RADIUS * theta / 90, 0, 2 * G_PI);
        cairo_stroke(cr);
        cairo_set_source_rgb(cr, 0.5, 0.5, 0.52);
        plot_text(cr, centre + 4, DISC_Y + DISC_RADIUS * theta / 90 - 5, 0, text);
    }
    for (int i = 0; i < n; i++) {
        const double r = DISC_RADIUS * theta_deg[i] / 90, phi = phi_deg[i] * G_PI / 180;
        set_heat(cr, most > 0 ? sums[i].error / most : 0);
        cairo_arc(cr, centre + r * cos(phi), DISC_Y - r * sin(phi), radius, 0, 2 * G_PI);
        cairo_fill_preserve(cr);
        cairo_set_source_rgba(cr, 0, 0, 0, 0.35);
        cairo_stroke(cr);
    }
    plot_ink(cr);
}

static double largest_error(const struct compare_sums *sums, int n, double most) {
    for (int i = 0; i < n; i++)
        most = isfinite(sums[i].error) ? MAX(most, sums[i].error) : most;
    return most;
}

gboolean plot_comparison(const char *path, const struct material_info *a,
                         const struct material_info *b, const struct comparison *c,
                         GError **error) {
    cairo_t *cr = plot_new(path, error);
    if (!cr)
        return FALSE;
    double most = largest_error(c->views, c->n_views, 0);
    most = largest_error(c->lights, c->n_lights, most);
    g_autofree char *title = g_strdup_printf("%s against %s", b->label, a->label);
    g_autofree char *text = g_strdup_printf(
        "relative error %.2f %%, luminance off by %.4f on average, ΔE %.2f; 1:%.0f in size",
        100 * c->all.error, c->all.luminance_error, c->all.delta_e,
        (double)a->bytes / (double)b->bytes);
    g_autofree char *scale = g_strdup_printf("%.3g %% relative error", 100 * most);
    plot_title(cr, 40, 50, title, text);
    draw_disc(cr, 330, "views", a->layout->views.theta_deg, a->layout->views.phi_deg, c->views,
              c->n_views, most);
    draw_disc(cr, 950, "lights", a->layout->lights.theta_deg, a->layout->lights.phi_deg, c->lights,
              c->n_lights, most);
    for (int i = 0; i < 250; i++) {
        set_heat(cr, i / 249.0);
        cairo_rectangle(cr, BAR_X + i * BAR_WIDTH / 250, BAR_Y - 14, BAR_WIDTH / 250 + 0.5, 18);
        cairo_fill(cr);
    }
    plot_ink(cr);
    plot_text(cr, BAR_X - 10, BAR_Y, 1, "0");
    plot_text(cr, BAR_X + BAR_WIDTH + 10, BAR_Y, 0, scale);
    return plot_finish(cr, path, error);
}
