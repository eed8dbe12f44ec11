#include "plot.h"

#include <math.h>

#define LEFT   110.0
#define RIGHT  (PLOT_WIDTH - 230.0)
#define TOP    110.0
#define BOTTOM (PLOT_HEIGHT - 90.0)
#define LINE   (PLOT_TEXT + 2)
#define LEAST  1e-4 /* Smaller errors are only rounding errors. They are drawn at this value. */

/* The ranges of the two logarithmic axes: raw_bytes divided by the size, and the error. */
struct axes {
    double ratio[2], error[2];
};

static double x_of(const struct axes *axes, double ratio) {
    return LEFT +
           (RIGHT - LEFT) * log(ratio / axes->ratio[0]) / log(axes->ratio[1] / axes->ratio[0]);
}

static double y_of(const struct axes *axes, double error) {
    return BOTTOM - (BOTTOM - TOP) * log(MAX(error, LEAST) / axes->error[0]) /
                        log(axes->error[1] / axes->error[0]);
}

static void widen(double range[2]) {
    range[0] /= 1.3;
    range[1] *= 1.3;
    if (!(range[1] / range[0] > 2)) {
        range[0] /= 1.5;
        range[1] *= 1.5;
    }
}

static struct axes fit_axes(double raw_bytes, const struct plot_point *points, int n) {
    struct axes axes = {{G_MAXDOUBLE, 0}, {G_MAXDOUBLE, 0}};
    for (int i = 0; i < n; i++) {
        const double ratio = raw_bytes / points[i].bytes, error = MAX(points[i].error, LEAST);
        axes.ratio[0] = MIN(axes.ratio[0], ratio);
        axes.ratio[1] = MAX(axes.ratio[1], ratio);
        axes.error[0] = MIN(axes.error[0], error);
        axes.error[1] = MAX(axes.error[1], error);
    }
    widen(axes.ratio);
    widen(axes.error);
    return axes;
}

static void draw_tick(cairo_t *cr, const struct axes *axes, gboolean on_x, double value) {
    const double *range = on_x ? axes->ratio : axes->error;
    if (value < range[0] || value > range[1])
        return;
    g_autofree char *text =
        on_x ? g_strdup_printf("1:%g", value)
             : g_strdup_printf(value < 1.5 * LEAST ? "≤ %g %%" : "%g %%", 100 * value);
    const double x = on_x ? x_of(axes, value) : LEFT, y = on_x ? BOTTOM : y_of(axes, value);
    cairo_set_source_rgb(cr, 0.88, 0.89, 0.90);
    cairo_set_line_width(cr, 1);
    cairo_move_to(cr, x, y);
    cairo_line_to(cr, on_x ? x : RIGHT, on_x ? TOP : y);
    cairo_stroke(cr);
    plot_ink(cr);
    if (on_x)
        plot_text(cr, x, BOTTOM + 26, 0.5, text);
    else
        plot_text(cr, LEFT - 10, y + 6, 1, text);
}

/* The points of one model. */
struct series {
    const struct plot_point *points; /* in order of size */
    int n, colour;
    double x, y; /* position of the point of the smallest size */
    double name; /* height of the base line of the series' name */
};

static void draw_series(cairo_t *cr, const struct axes *axes, double raw_bytes,
                        const struct series *series) {
    plot_colour(cr, series->colour);
    cairo_set_line_width(cr, 2.2);
    for (int i = 0; i < series->n; i++)
        cairo_line_to(cr, x_of(axes, raw_bytes / series->points[i].bytes),
                      y_of(axes, series->points[i].error));
    cairo_stroke(cr);
    for (int i = 0; i < series->n; i++) {
        const double x = x_of(axes, raw_bytes / series->points[i].bytes);
        const double y = y_of(axes, series->points[i].error);
        /* Markers are round, square or pointed, so that series differ not only in colour. */
        if (series->colour % 3 == 0) {
            cairo_arc(cr, x, y, 4.5, 0, 2 * G_PI);
        } else if (series->colour % 3 == 1) {
            cairo_rectangle(cr, x - 4, y - 4, 8, 8);
        } else {
            cairo_move_to(cr, x, y - 6);
            cairo_line_to(cr, x + 5.5, y + 4);
            cairo_line_to(cr, x - 5.5, y + 4);
        }
        cairo_fill(cr);
    }
}

static int by_height(gconstpointer a, gconstpointer b) {
    const struct series *p = a, *q = b;
    if (p->y != q->y)
        return p->y < q->y ? -1 : 1;
    return (p->x < q->x) - (p->x > q->x);
}

/* Places the names of the series one below the other, in the order of the heights of their points,
 * so that few lines from a name to its point cross. */
static void place_names(GArray *list) {
    g_array_sort(list, by_height);
    for (guint i = 0; i < list->len; i++) {
        struct series *series = &g_array_index(list, struct series, i);
        series->name = MAX(series->y + 6, i ? series[-1].name + LINE : TOP);
    }
    for (guint i = list->len; i-- > 0;) {
        struct series *series = &g_array_index(list, struct series, i);
        series->name = MIN(series->name, i + 1 < list->len ? series[1].name - LINE : BOTTOM);
    }
}

static GArray *part_series(const struct axes *axes, double raw_bytes,
                           const struct plot_point *points, int n) {
    GArray *list = g_array_new(FALSE, FALSE, sizeof(struct series));
    for (int from = 0, end; from < n; from = end) {
        for (end = from; end < n && g_str_equal(points[end].series, points[from].series);)
            end++;
        const struct series series = {.points = points + from,
                                      .n = end - from,
                                      .colour = (int)list->len,
                                      .x = x_of(axes, raw_bytes / points[from].bytes),
                                      .y = y_of(axes, points[from].error)};
        g_array_append_val(list, series);
    }
    return list;
}

gboolean plot_curve(const char *path, const char *name, const char *text, double raw_bytes,
                    const struct plot_point *points, int n, GError **error) {
    cairo_t *cr = plot_new(path, error);
    if (!cr)
        return FALSE;
    const struct axes axes = fit_axes(raw_bytes, points, n);
    g_autoptr(GArray) list = part_series(&axes, raw_bytes, points, n);
    g_autofree char *title = g_strdup_printf("%s: error against size", name);
    const double dashes[] = {2, 4}, steps[] = {1, 2, 5};
    plot_title(cr, 40, 50, title, text);
    for (int power = -6; power <= 6; power++)
        for (int i = 0; i < 3; i++) {
            draw_tick(cr, &axes, TRUE, steps[i] * pow(10, power));
            draw_tick(cr, &axes, FALSE, steps[i] * pow(10, power));
        }
    plot_text(cr, (LEFT + RIGHT) / 2, BOTTOM + 60, 0.5,
              "size relative to the BTF in half floats: in a renderer, or on disk if packed");
    place_names(list);
    for (guint i = 0; i < list->len; i++) {
        const struct series *series = &g_array_index(list, struct series, i);
        plot_colour(cr, series->colour);
        plot_text(cr, RIGHT + 14, series->name, 0, series->points[0].series);
        cairo_set_line_width(cr, 0.8);
        cairo_move_to(cr, RIGHT + 10, series->name - 6);
        cairo_line_to(cr, series->x + 7, series->y);
        cairo_set_dash(cr, dashes, 2, 0);
        cairo_stroke(cr);
        cairo_set_dash(cr, NULL, 0, 0);
    }
    for (guint i = 0; i < list->len; i++)
        draw_series(cr, &axes, raw_bytes, &g_array_index(list, struct series, i));
    return plot_finish(cr, path, error);
}
