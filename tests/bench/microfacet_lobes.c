#include "microfacet_parts.h"

#include "bench.h"
#include "lib/microfacet_formula.h"

#include <cairo.h>
#include <math.h>

#define DISC  120 /* pixels across a hemisphere */
#define TILTS 5   /* of 0, 15 … 60 degrees */

/* The distribution of microfacets for a half vector in their own frame: Kang & Cho 2011 eq. 1 and
 * 3, without the factor that does not depend on it, with the parameters of their fig. 5. */
static double lobes_distribution(enum microfacet_model model, gboolean isotropic, struct vec3 h) {
    const double flat = h.x * h.x + h.y * h.y;
    const double u = isotropic ? 20 : 1, v = isotropic ? 20 : 40;
    if (model == MICROFACET_WARD) {
        const double x = h.x / (isotropic ? 0.3 : 0.1), y = h.y / (isotropic ? 0.3 : 0.5);
        return exp(-2 * (x * x + y * y) / (1 + fmax(h.z, 0)));
    }
    return h.z > 0 ? pow(h.z, flat > 0 ? (u * h.x * h.x + v * h.y * h.y) / flat : 0) : 0;
}

static const struct {
    const char *name;
    enum microfacet_model model;
    gboolean isotropic;
    enum method_rotation rotation;
} lobes_rows[] = {
    {"isotropic, none", MICROFACET_ASHIKHMIN, TRUE, METHOD_ROTATION_NONE},
    {"A.–S., none", MICROFACET_ASHIKHMIN, FALSE, METHOD_ROTATION_NONE},
    {"A.–S., approximate", MICROFACET_ASHIKHMIN, FALSE, METHOD_ROTATION_APPROXIMATE},
    {"A.–S., exact", MICROFACET_ASHIKHMIN, FALSE, METHOD_ROTATION_EXACT},
    {"Ward, none", MICROFACET_WARD, FALSE, METHOD_ROTATION_NONE},
    {"Ward, approximate", MICROFACET_WARD, FALSE, METHOD_ROTATION_APPROXIMATE},
    {"Ward, exact", MICROFACET_WARD, FALSE, METHOD_ROTATION_EXACT},
};

static void lobes_draw_disc(cairo_surface_t *surface, int left, int top, int row, struct vec3 n) {
    guint8 *pixels = cairo_image_surface_get_data(surface);
    const int stride = cairo_image_surface_get_stride(surface);
    for (int j = 0; j < DISC; j++)
        for (int i = 0; i < DISC; i++) {
            const double x = 2 * (i + 0.5) / DISC - 1, y = 1 - 2 * (j + 0.5) / DISC;
            if (x * x + y * y >= 1)
                continue;
            const struct vec3 h = {x, y, sqrt(1 - x * x - y * y)};
            const double d = lobes_distribution(lobes_rows[row].model, lobes_rows[row].isotropic,
                                                microfacet_half(h, n, lobes_rows[row].rotation));
            const guint grey = (guint)lrint(255 * sqrt(CLAMP(d, 0, 1)));
            guint32 *pixel =
                (guint32 *)(gpointer)(pixels + (gsize)(top + j) * (gsize)stride) + left + i;
            *pixel = grey << 16 | grey << 8 | grey;
        }
}

static void lobes_cross(cairo_t *cr, double x, double y) {
    cairo_set_source_rgb(cr, 0.9, 0.1, 0.1);
    cairo_set_line_width(cr, 1.5);
    cairo_move_to(cr, x - 5, y);
    cairo_line_to(cr, x + 5, y);
    cairo_move_to(cr, x, y - 5);
    cairo_line_to(cr, x, y + 5);
    cairo_stroke(cr);
}

void microfacet_lobes(const char *path) {
    const int rows = G_N_ELEMENTS(lobes_rows), step = DISC + 8, label = 150;
    cairo_surface_t *surface =
        cairo_image_surface_create(CAIRO_FORMAT_RGB24, label + TILTS * step, rows * step + 24);
    cairo_t *cr = cairo_create(surface);
    cairo_set_source_rgb(cr, 1, 1, 1);
    cairo_paint(cr);
    cairo_select_font_face(cr, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(cr, 14);
    for (int row = 0; row < rows; row++) {
        cairo_set_source_rgb(cr, 0.1, 0.1, 0.1);
        cairo_move_to(cr, 8, 24 + row * step + DISC / 2.0);
        cairo_show_text(cr, lobes_rows[row].name);
        cairo_surface_flush(surface);
        for (int k = 0; k < TILTS; k++) {
            const double theta = 15 * k * G_PI / 180, phi = 50 * G_PI / 180;
            const struct vec3 n = {sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)};
            lobes_draw_disc(surface, label + k * step, 24 + row * step, row, n);
        }
        cairo_surface_mark_dirty(surface);
        for (int k = 0; k < TILTS; k++) {
            const double theta = 15 * k * G_PI / 180, phi = 50 * G_PI / 180;
            lobes_cross(cr, label + k * step + 0.5 * DISC * (1 + sin(theta) * cos(phi)),
                        24 + row * step + 0.5 * DISC * (1 - sin(theta) * sin(phi)));
        }
    }
    for (int k = 0; k < TILTS; k++) {
        g_autofree char *text = g_strdup_printf("%d°", 15 * k);
        cairo_set_source_rgb(cr, 0.1, 0.1, 0.1);
        cairo_move_to(cr, label + k * step + DISC / 2.0 - 8, 16);
        cairo_show_text(cr, text);
    }
    const cairo_status_t status = cairo_surface_write_to_png(surface, path);
    cairo_destroy(cr);
    cairo_surface_destroy(surface);
    if (status != CAIRO_STATUS_SUCCESS)
        bench_fail(1, "%s: %s", path, cairo_status_to_string(status));
}
