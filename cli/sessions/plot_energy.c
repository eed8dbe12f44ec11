#include "check.h"

#include <math.h>

#define LEFT   90.0
#define RIGHT  (PLOT_WIDTH - 60.0)
#define HEIGHT 250.0

static double most_of(double most, const double *values, int n) {
    for (int i = 0; i < n; i++)
        most = MAX(most, values[i]);
    return most;
}

/* Returns the upper end of an axis that has four round steps and contains the value `most`. */
static double round_up(double most) {
    static const double steps[] = {1, 2, 2.5, 5, 10};
    double decade = pow(10, floor(log10(most / 4)));
    int i = 0;
    while (i < 4 && 4 * steps[i] * decade < most)
        i++;
    return 4 * steps[i] * decade;
}

/* Draws one diagram. bottom is its lower edge. */
static void draw_diagram(cairo_t *cr, double bottom, const char *title, const double *e_r,
                         int n_views, const double *e_i, int n_lights) {
    const struct {
        const double *values;
        int n;
        double name_x;
        const char *name;
    } series[2] = {{e_i, n_lights, RIGHT - 190, "E_i of each light"},
                   {e_r, n_views, RIGHT - 400, "E_r of each view"}};
    const double most = round_up(most_of(most_of(1e-6, e_r, n_views), e_i, n_lights));
    cairo_set_line_width(cr, 1);
    for (int k = 0; k <= 4; k++) {
        const double y = bottom - HEIGHT * k / 4;
        g_autofree char *text = g_strdup_printf("%.3g", most * k / 4);
        cairo_set_source_rgb(cr, 0.86, 0.87, 0.88);
        cairo_move_to(cr, LEFT, y);
        cairo_line_to(cr, RIGHT, y);
        cairo_stroke(cr);
        plot_ink(cr);
        plot_text(cr, LEFT - 10, y + 6, 1, text);
    }
    plot_text(cr, LEFT, bottom - HEIGHT - 14, 0, title);
    cairo_set_line_width(cr, 1.8);
    for (int s = 1; s >= 0; s--) {
        const int n = series[s].n;
        plot_colour(cr, s);
        for (int i = 0; i < n; i++)
            cairo_line_to(cr, LEFT + (RIGHT - LEFT) * (n > 1 ? (double)i / (n - 1) : 0.5),
                          bottom - HEIGHT * series[s].values[i] / most);
        cairo_stroke(cr);
        cairo_rectangle(cr, series[s].name_x, bottom - HEIGHT - 14 - 9, 26, 5);
        cairo_fill(cr);
        plot_ink(cr);
        plot_text(cr, series[s].name_x + 34, bottom - HEIGHT - 14, 0, series[s].name);
    }
}

gboolean plot_energy(const char *path, const struct btf_matrix *btf, const struct energy *e,
                     GError **error) {
    cairo_t *cr = plot_new(path, error);
    if (!cr)
        return FALSE;
    g_autofree char *title = g_strdup_printf("Energy of %s", btf->name);
    g_autofree char *one = g_strdup_printf("texel %d", e->texel);
    g_autofree char *symmetry = g_strdup_printf(
        "; not reciprocal by %.2f %% of the mean, %.2f %% texel by texel (%d pairs)",
        100 * e->asymmetry, 100 * e->texel_asymmetry, e->pairs);
    g_autofree char *text = g_strdup_printf("at most %.3f of a light's energy is reflected%s",
                                            e->largest_albedo, e->pairs > 0 ? symmetry : "");
    plot_title(cr, LEFT, 38, title, text);
    draw_diagram(cr, 380, one, e->texel_e_r, e->n_views, e->texel_e_i, e->n_lights);
    draw_diagram(cr, 715, "mean over all texels", e->e_r, e->n_views, e->e_i, e->n_lights);
    plot_text(cr, 0.5 * (LEFT + RIGHT), 765, 0.5, "views and lights in the session's order");
    return plot_finish(cr, path, error);
}
