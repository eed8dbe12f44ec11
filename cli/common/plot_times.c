#include "plot.h"

#include <math.h>

#define LEFT   110.0
#define RIGHT  (PLOT_WIDTH - 60.0)
#define TOP    120.0
#define BOTTOM (PLOT_HEIGHT - 90.0)

/* The ranges of the axes: minutes from 0 to max_min, and errors in %, on a logarithmic axis. */
struct plot_times_axes {
    double max_min, error_pct[2];
};

static double plot_times_x(const struct plot_times_axes *axes, double minutes) {
    return LEFT + (RIGHT - LEFT) * minutes / axes->max_min;
}

static double plot_times_y(const struct plot_times_axes *axes, double error_pct) {
    return BOTTOM - (BOTTOM - TOP) * log(MAX(error_pct, axes->error_pct[0]) / axes->error_pct[0]) /
                        log(axes->error_pct[1] / axes->error_pct[0]);
}

static void rule(cairo_t *cr, double x0, double y0, double x1, double y1) {
    cairo_set_source_rgb(cr, 0.88, 0.89, 0.90);
    cairo_set_line_width(cr, 1);
    cairo_move_to(cr, x0, y0);
    cairo_line_to(cr, x1, y1);
    cairo_stroke(cr);
    plot_ink(cr);
}

static void ticks(cairo_t *cr, const struct plot_times_axes *axes) {
    static const double steps[] = {1, 2, 5};
    double step = 0.01;
    for (int i = 1; axes->max_min / step > 8 && i < 24; i++) {
        const int decade = i / 3;
        step = 0.01 * steps[i % 3] * pow(10, decade);
    }
    for (double at = 0; at <= axes->max_min; at += step) {
        g_autofree char *text = g_strdup_printf("%g", at);
        const double x = plot_times_x(axes, at);
        rule(cr, x, TOP, x, BOTTOM);
        plot_text(cr, x, BOTTOM + 26, 0.5, text);
    }
    for (int i = -6; i < 12; i++) {
        const double at = steps[(i + 6) % 3] * pow(10, floor(i / 3.0));
        g_autofree char *text = g_strdup_printf("%g %%", at);
        const double y = plot_times_y(axes, at);
        if (at < axes->error_pct[0] * (1 - 1e-9) || at > axes->error_pct[1] * (1 + 1e-9))
            continue;
        rule(cr, LEFT, y, RIGHT, y);
        plot_text(cr, LEFT - 10, y + 6, 1, text);
    }
}

gboolean plot_times(const char *path, const char *title, const char *text, double all_min,
                    const struct plot_time *points, int n, GError **error) {
    cairo_t *cr = plot_new(path, error);
    if (!cr)
        return FALSE;
    struct plot_times_axes axes = {1.05 * all_min, {G_MAXDOUBLE, 0}};
    for (int i = 0; i < n; i++) {
        axes.max_min = MAX(axes.max_min, 1.05 * points[i].minutes);
        axes.error_pct[0] = MIN(axes.error_pct[0], MAX(points[i].error_pct, 0.01));
        axes.error_pct[1] = MAX(axes.error_pct[1], points[i].error_pct);
    }
    axes.error_pct[0] /= 1.5;
    axes.error_pct[1] = MAX(axes.error_pct[1], axes.error_pct[0]) * 1.5;
    plot_title(cr, 40, 50, title, text);
    ticks(cr, &axes);
    plot_text(cr, (LEFT + RIGHT) / 2, BOTTOM + 60, 0.5, "minutes that the lamps' shots take");
    g_autofree char *all = g_strdup_printf("all shots: %.1f min", all_min);
    const double end = plot_times_x(&axes, all_min);
    plot_text(cr, end - 8, TOP + 18, 1, all);
    cairo_set_line_width(cr, 1.4);
    cairo_move_to(cr, end, TOP);
    cairo_line_to(cr, end, BOTTOM);
    cairo_stroke(cr);
    plot_colour(cr, 0);
    cairo_set_line_width(cr, 2.2);
    for (int i = 0; i < n; i++)
        cairo_line_to(cr, plot_times_x(&axes, points[i].minutes),
                      plot_times_y(&axes, points[i].error_pct));
    cairo_stroke(cr);
    for (int i = 0; i < n; i++) {
        const double x = plot_times_x(&axes, points[i].minutes);
        const double y = plot_times_y(&axes, points[i].error_pct);
        g_autofree char *shots = g_strdup_printf("%d", points[i].shots);
        plot_colour(cr, 0);
        cairo_arc(cr, x, y, 4.5, 0, 2 * G_PI);
        cairo_fill(cr);
        plot_ink(cr);
        plot_text(cr, x + 8, y - 10, 0, shots);
    }
    return plot_finish(cr, path, error);
}
