#include "demo_pictures.h"

#include <cairo.h>
#include <gio/gio.h>
#include <math.h>

/* Pixels; LINE: of a line of text; PANEL: at most the width of a picture of the MDF. */
enum { PANEL = 384, GAP = 8, BAR = 14, LINE = 18 };

/* Pixels of a texel. */
static int scale_of(const struct session_grid *grid, int panel) {
    return MAX(1, panel / grid->width);
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

/* Text next to the panels; y is the top of its line. */
struct caption {
    int x, y;
    gboolean to_left; /* x is its right end */
    char *text;
};

static void caption_clear(gpointer caption) {
    g_free(((struct caption *)caption)->text);
}

static GArray *captions_new(void) {
    GArray *captions = g_array_new(FALSE, FALSE, sizeof(struct caption));
    g_array_set_clear_func(captions, caption_clear);
    return captions;
}

static void G_GNUC_PRINTF(5, 6)
    captions_add(GArray *captions, int x, int y, gboolean to_left, const char *format, ...) {
    va_list values;
    va_start(values, format);
    const struct caption caption = {x, y, to_left, g_strdup_vprintf(format, values)};
    va_end(values);
    g_array_append_val(captions, caption);
}

static gboolean write_png(const char *path, const guint8 *rgb, int width, int height,
                          const GArray *captions, GError **error) {
    cairo_surface_t *surface = cairo_image_surface_create(CAIRO_FORMAT_RGB24, width, height);
    guint8 *pixels = cairo_image_surface_get_data(surface);
    const int stride = cairo_image_surface_get_stride(surface);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            const guint8 *from = rgb + ((gsize)y * width + x) * 3;
            const guint32 to = (guint32)from[0] << 16 | (guint32)from[1] << 8 | from[2];
            memcpy(pixels + (gsize)y * stride + (gsize)x * 4, &to, sizeof to);
        }
    cairo_surface_mark_dirty(surface);
    cairo_t *cr = cairo_create(surface);
    cairo_select_font_face(cr, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(cr, 13);
    cairo_set_source_rgb(cr, 0.92, 0.92, 0.92);
    for (guint i = 0; i < captions->len; i++) {
        const struct caption *caption = &g_array_index(captions, struct caption, i);
        cairo_text_extents_t extents;
        cairo_text_extents(cr, caption->text, &extents);
        cairo_move_to(cr, caption->to_left ? caption->x - extents.x_advance : caption->x,
                      caption->y + LINE - 5);
        cairo_show_text(cr, caption->text);
    }
    cairo_status_t status = cairo_status(cr);
    cairo_destroy(cr);
    if (status == CAIRO_STATUS_SUCCESS)
        status = cairo_surface_write_to_png(surface, path);
    cairo_surface_destroy(surface);
    if (status != CAIRO_STATUS_SUCCESS)
        g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_IO, "%s: %s", path,
                    cairo_status_to_string(status));
    return status == CAIRO_STATUS_SUCCESS;
}

static void blow_up(guint8 *picture, int stride, int x0, int y0, int scale, const guint8 *rgb) {
    for (int y = 0; y < scale; y++)
        for (int x = 0; x < scale; x++)
            memcpy(picture + ((gsize)(y0 + y) * stride + x0 + x) * 3, rgb, 3);
}

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
gboolean demo_write_mdf(const char *path, const struct session_grid *grid, const float *measured,
                        const float *truth, GError **error) {
    const int w = grid->width, h = grid->height, scale = scale_of(grid, PANEL);
    const int width = 3 * w * scale + 2 * GAP, height = LINE + h * scale + GAP + BAR + LINE;
    const int panel = w * scale, step = panel + GAP, bars = LINE + h * scale + GAP;
    const float span = (float)(0.25 * grid->width_mm / w);
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
            blow_up(picture, width, x * scale, LINE + y * scale, scale, rgb);
            height_colour(t, least, most, rgb);
            blow_up(picture, width, step + x * scale, LINE + y * scale, scale, rgb);
            if (d < 0 || t < 0)
                height_colour(-1, least, most, rgb);
            else
                difference_colour(d - t, span, rgb);
            blow_up(picture, width, 2 * step + x * scale, LINE + y * scale, scale, rgb);
        }
    paint_bars(picture, width, panel, bars, least, most);
    static const char *const titles[] = {"measured depth", "true depth", "measured − true"};
    const float from[] = {most, most, -span}, to[] = {least, least, span};
    g_autoptr(GArray) captions = captions_new();
    for (int i = 0; i < 3; i++) {
        captions_add(captions, i * step + 2, 0, FALSE, "%s", titles[i]);
        captions_add(captions, i * step + 2, bars + BAR, FALSE, i < 2 ? "%.2f mm" : "%+.2f mm",
                     (double)from[i]);
        captions_add(captions, i * step + panel - 2, bars + BAR, TRUE,
                     i < 2 ? "%.2f mm" : "%+.2f mm", (double)to[i]);
    }
    captions_add(captions, panel - 2, 0, TRUE, "grey: not measured");
    return write_png(path, picture, width, height, captions, error);
}

static guint8 to_srgb(float value) {
    const float v = CLAMP(value, 0.0f, 1.0f);
    return (guint8)(255 * (v <= 0.0031308f ? 12.92f * v : 1.055f * powf(v, 1 / 2.4f) - 0.055f) +
                    0.5f);
}

struct demo_btf {
    struct session_grid grid;
    int width, height, n; /* n: columns */
    int scale;            /* pixels of a texel */
    guint8 *picture;
    GArray *captions;
};

struct demo_btf *demo_btf_new(const struct session_grid *grid) {
    struct demo_btf *btf = g_new0(struct demo_btf, 1);
    btf->grid = *grid;
    btf->scale = scale_of(grid, PANEL / 2);
    btf->width = DEMO_BTF_COLUMNS * (grid->width * btf->scale + GAP) - GAP;
    btf->height = 2 * LINE + 3 * (LINE + grid->height * btf->scale);
    btf->picture = g_malloc((gsize)btf->width * btf->height * 3);
    memset(btf->picture, 40, (gsize)btf->width * btf->height * 3);
    btf->captions = captions_new();
    static const char *const titles[] = {"measured", "true", "four times measured − true"};
    for (int row = 0; row < 3; row++)
        captions_add(btf->captions, 2, 2 * LINE + row * (LINE + grid->height * btf->scale), FALSE,
                     "%s", titles[row]);
    return btf;
}

void demo_btf_free(struct demo_btf *btf) {
    if (!btf)
        return;
    g_free(btf->picture);
    g_array_unref(btf->captions);
    g_free(btf);
}

gboolean demo_btf_add(struct demo_btf *btf, const struct exr_part *part,
                      const struct session_direction *view, const struct session_direction *light,
                      const float *truth) {
    const float *planes[3] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                              exr_part_plane(part, "B")};
    const int w = btf->grid.width, h = btf->grid.height;
    const int left = btf->n * (w * btf->scale + GAP);
    if (btf->n == DEMO_BTF_COLUMNS)
        return FALSE;
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            guint8 rgb[3][3];
            for (int c = 0; c < 3; c++) {
                const float is = planes[c][y * w + x], should = truth[(y * w + x) * 3 + c];
                rgb[0][c] = to_srgb(is);
                rgb[1][c] = to_srgb(should);
                rgb[2][c] = (guint8)CLAMP(127.5f + 4 * 255 * (is - should), 0.0f, 255.0f);
            }
            const int top = 3 * LINE + y * btf->scale;
            for (int row = 0; row < 3; row++)
                blow_up(btf->picture, btf->width, left + x * btf->scale,
                        top + row * (LINE + h * btf->scale), btf->scale, rgb[row]);
        }
    captions_add(btf->captions, left + 2, 0, FALSE, "view θ %.0f°, φ %.0f°", view->theta_deg,
                 view->phi_deg);
    captions_add(btf->captions, left + 2, LINE, FALSE, "light θ %.0f°, φ %.0f°", light->theta_deg,
                 light->phi_deg);
    btf->n++;
    return TRUE;
}

int demo_btf_columns(const struct demo_btf *btf) {
    return btf->n;
}

gboolean demo_btf_write(const struct demo_btf *btf, const char *path, GError **error) {
    return write_png(path, btf->picture, btf->width, btf->height, btf->captions, error);
}
