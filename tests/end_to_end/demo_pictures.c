#include "demo_pictures.h"

#include <math.h>
#include <png.h>

enum { SCALE = 6, GAP = 8, BAR = 14 };

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
    const int w = grid->width, h = grid->height;
    const int width = 3 * w * SCALE + 2 * GAP, height = h * SCALE + GAP + BAR;
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
        path, (double)most, (double)least, (double)-span, (double)span);
    return write_png(path, picture, width, height, error);
}

static guint8 to_srgb(float value) {
    const float v = CLAMP(value, 0.0f, 1.0f);
    return (guint8)(255 * (v <= 0.0031308f ? 12.92f * v : 1.055f * powf(v, 1 / 2.4f) - 0.055f) +
                    0.5f);
}

struct demo_btf {
    struct session_grid grid;
    int width, height, n; /* n: columns */
    guint8 *picture;
};

enum { BTF_SCALE = SCALE / 2 };

struct demo_btf *demo_btf_new(const struct session_grid *grid) {
    struct demo_btf *btf = g_new0(struct demo_btf, 1);
    btf->grid = *grid;
    btf->width = DEMO_BTF_COLUMNS * (grid->width * BTF_SCALE + GAP) - GAP;
    btf->height = 3 * (grid->height * BTF_SCALE + GAP) - GAP;
    btf->picture = g_malloc0((gsize)btf->width * btf->height * 3);
    return btf;
}

void demo_btf_free(struct demo_btf *btf) {
    if (!btf)
        return;
    g_free(btf->picture);
    g_free(btf);
}

/* Measured, true, and four times the difference around grey, one below the other. */
gboolean demo_btf_add(struct demo_btf *btf, const struct exr_part *part, const float *truth) {
    const float *planes[3] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                              exr_part_plane(part, "B")};
    const int w = btf->grid.width, h = btf->grid.height;
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
            const int left = btf->n * (w * BTF_SCALE + GAP) + x * BTF_SCALE;
            for (int row = 0; row < 3; row++)
                blow_up(btf->picture, btf->width, left, row * (h * BTF_SCALE + GAP) + y * BTF_SCALE,
                        BTF_SCALE, rgb[row]);
        }
    btf->n++;
    return TRUE;
}

int demo_btf_columns(const struct demo_btf *btf) {
    return btf->n;
}

gboolean demo_btf_write(const struct demo_btf *btf, const char *path, GError **error) {
    return write_png(path, btf->picture, btf->width, btf->height, error);
}
