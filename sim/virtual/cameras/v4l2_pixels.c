#include "v4l2_private.h"

#include <string.h>

/* Each row is padded to a multiple of this number of bytes, as on many devices. */
#define ROW_ALIGN 32

struct layout {
    int bits, bytes, pixels; /* `bytes` bytes hold `pixels` pixels */
    guint32 fourcc[5];       /* indexed by enum cfa */
};

#define RAW(mono, depth)                                                                           \
    {                                                                                              \
        mono, V4L2_PIX_FMT_SRGGB##depth, V4L2_PIX_FMT_SBGGR##depth, V4L2_PIX_FMT_SGRBG##depth,     \
            V4L2_PIX_FMT_SGBRG##depth                                                              \
    }
#define LUMA(fourcc)                                                                               \
    { fourcc, fourcc, fourcc, fourcc, fourcc }
static const struct layout layouts[] = {
    {8, 1, 1, RAW(V4L2_PIX_FMT_GREY, 8)},
    {10, 2, 1, RAW(V4L2_PIX_FMT_Y10, 10)},
    {10, 5, 4, RAW(V4L2_PIX_FMT_Y10P, 10P)},
    {12, 2, 1, RAW(V4L2_PIX_FMT_Y12, 12)},
    {12, 3, 2, RAW(0, 12P)},
    {16, 2, 1, RAW(V4L2_PIX_FMT_Y16, 16)},
    {8, 2, 1, LUMA(V4L2_PIX_FMT_YUYV)},
    {8, 2, 1, LUMA(V4L2_PIX_FMT_UYVY)},
};

static const struct layout *v4l2_pixels_find(guint32 fourcc) {
    for (gsize i = 0; i < G_N_ELEMENTS(layouts); i++)
        for (gsize cfa = 0; cfa < G_N_ELEMENTS(layouts[i].fourcc); cfa++)
            if (fourcc && layouts[i].fourcc[cfa] == fourcc)
                return &layouts[i];
    return NULL;
}

gboolean virtual_pixels_offered(const struct virtual_v4l2_config *config, guint32 index,
                                guint32 *ret_fourcc) {
    if (index == 0 || config->only_compressed) {
        *ret_fourcc = V4L2_PIX_FMT_MJPEG;
        return index == 0;
    }
    for (gsize i = 0; i < G_N_ELEMENTS(layouts); i++) {
        *ret_fourcc = layouts[i].fourcc[config->cfa];
        if (*ret_fourcc && layouts[i].bits <= MAX(config->bits, 8) && --index == 0)
            return TRUE;
    }
    return FALSE;
}

gsize virtual_pixels_stride(guint32 fourcc, int width) {
    const struct layout *layout = v4l2_pixels_find(fourcc);
    if (!layout)
        return 0;
    gsize groups = ((gsize)width + (gsize)layout->pixels - 1) / (gsize)layout->pixels;
    return (groups * (gsize)layout->bytes + ROW_ALIGN - 1) / ROW_ALIGN * ROW_ALIGN;
}

gsize virtual_pixels_size(guint32 fourcc, int width, int height) {
    return virtual_pixels_stride(fourcc, width) * (gsize)height;
}

/* Packs a row. Depending on the format, a pixel is a byte or a word, or pixels are packed in
 * groups. A group has first the upper eight bits of each pixel, and then the lower bits of all
 * pixels. */
static void pack_row(const struct layout *layout, const guint16 *from, int width, int shift,
                     guint8 *to) {
    int low = layout->bits - 8, per = layout->pixels;
    for (int x = 0; x < width; x++) {
        guint16 value = (guint16)(shift < 0 ? from[x] << -shift : from[x] >> shift);
        if (layout->bytes == 1) {
            to[x] = (guint8)value;
        } else if (per == 1) {
            to[2 * x] = (guint8)value;
            to[2 * x + 1] = (guint8)(value >> 8);
        } else {
            guint8 *group = to + x / per * layout->bytes;
            group[x % per] = (guint8)(value >> low);
            group[per] |= (guint8)((value & ((1 << low) - 1)) << x % per * low);
        }
    }
}

/* Packs a row as YUYV or UYVY, without colour. The luma has the limited range 16 … 235. If the
 * sensor has colour filters, each value is the mean of 2 × 2 pixels, which have all filter colours
 * together. */
static void pack_luma(const struct virtual_v4l2_config *config, guint32 fourcc,
                      const guint16 *pixels, int y, guint8 *to) {
    int first = fourcc == V4L2_PIX_FMT_YUYV ? 0 : 1, most = (1 << config->bits) - 1;
    for (int x = 0; x < config->width; x++) {
        int sum = 0, step = config->cfa != CFA_MONO;
        for (int i = 0; i < 4; i++) {
            int u = MIN(x + (i & 1) * step, config->width - 1);
            int v = MIN(y + (i >> 1) * step, config->height - 1);
            sum += pixels[v * config->width + u];
        }
        to[2 * x + first] = (guint8)(16 + (sum * 219 / 4 + most / 2) / most);
        to[2 * x + 1 - first] = 128;
    }
}

void virtual_pixels_pack(const struct virtual_v4l2_config *config, guint32 fourcc,
                         const guint16 *pixels, guint8 *to) {
    const struct layout *layout = v4l2_pixels_find(fourcc);
    gsize stride = virtual_pixels_stride(fourcc, config->width);
    memset(to, 0, stride * (gsize)config->height);
    for (int y = 0; y < config->height; y++) {
        if (fourcc == V4L2_PIX_FMT_YUYV || fourcc == V4L2_PIX_FMT_UYVY)
            pack_luma(config, fourcc, pixels, y, to + (gsize)y * stride);
        else
            pack_row(layout, pixels + (gsize)y * (gsize)config->width, config->width,
                     config->bits - layout->bits, to + (gsize)y * stride);
    }
}
