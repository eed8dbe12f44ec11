#include "formats.h"

#include <linux/videodev2.h>
#include <string.h>

#define BAYER(bggr, gbrg, grbg, rggb, bits, packing)                                               \
    {bggr, CFA_BGGR, bits, packing}, {gbrg, CFA_GBRG, bits, packing},                              \
        {grbg, CFA_GRBG, bits, packing}, {                                                         \
        rggb, CFA_RGGB, bits, packing                                                              \
    }

static const struct video_format formats[] = {
    BAYER(V4L2_PIX_FMT_SBGGR8, V4L2_PIX_FMT_SGBRG8, V4L2_PIX_FMT_SGRBG8, V4L2_PIX_FMT_SRGGB8, 8,
          VIDEO_BYTES),
    BAYER(V4L2_PIX_FMT_SBGGR10, V4L2_PIX_FMT_SGBRG10, V4L2_PIX_FMT_SGRBG10, V4L2_PIX_FMT_SRGGB10,
          10, VIDEO_WORDS),
    BAYER(V4L2_PIX_FMT_SBGGR10P, V4L2_PIX_FMT_SGBRG10P, V4L2_PIX_FMT_SGRBG10P,
          V4L2_PIX_FMT_SRGGB10P, 10, VIDEO_MIPI10),
    BAYER(V4L2_PIX_FMT_SBGGR12, V4L2_PIX_FMT_SGBRG12, V4L2_PIX_FMT_SGRBG12, V4L2_PIX_FMT_SRGGB12,
          12, VIDEO_WORDS),
    BAYER(V4L2_PIX_FMT_SBGGR12P, V4L2_PIX_FMT_SGBRG12P, V4L2_PIX_FMT_SGRBG12P,
          V4L2_PIX_FMT_SRGGB12P, 12, VIDEO_MIPI12),
    BAYER(V4L2_PIX_FMT_SBGGR14, V4L2_PIX_FMT_SGBRG14, V4L2_PIX_FMT_SGRBG14, V4L2_PIX_FMT_SRGGB14,
          14, VIDEO_WORDS),
    BAYER(V4L2_PIX_FMT_SBGGR16, V4L2_PIX_FMT_SGBRG16, V4L2_PIX_FMT_SGRBG16, V4L2_PIX_FMT_SRGGB16,
          16, VIDEO_WORDS),
    {V4L2_PIX_FMT_GREY, CFA_MONO, 8, VIDEO_BYTES},
    {V4L2_PIX_FMT_Y10, CFA_MONO, 10, VIDEO_WORDS},
    {V4L2_PIX_FMT_Y10P, CFA_MONO, 10, VIDEO_MIPI10},
    {V4L2_PIX_FMT_Y12, CFA_MONO, 12, VIDEO_WORDS},
    {V4L2_PIX_FMT_Y14, CFA_MONO, 14, VIDEO_WORDS},
    {V4L2_PIX_FMT_Y16, CFA_MONO, 16, VIDEO_WORDS},
    {V4L2_PIX_FMT_YUYV, CFA_MONO, 8, VIDEO_YUYV},
    {V4L2_PIX_FMT_UYVY, CFA_MONO, 8, VIDEO_UYVY},
};

const struct video_format *video_format_find(guint32 fourcc) {
    for (gsize i = 0; i < G_N_ELEMENTS(formats); i++)
        if (formats[i].fourcc == fourcc)
            return &formats[i];
    return NULL;
}

gboolean video_format_is_luma(const struct video_format *format) {
    return format->packing == VIDEO_YUYV || format->packing == VIDEO_UYVY;
}

static int worth(const struct video_format *format) {
    if (!format)
        return -1;
    int kind = format->cfa != CFA_MONO ? 2 : video_format_is_luma(format) ? 0 : 1;
    return kind * 1000 + format->bits * 10 + (format->packing != VIDEO_WORDS);
}

const struct video_format *video_format_better(const struct video_format *a,
                                               const struct video_format *b) {
    return worth(b) > worth(a) ? b : a;
}

/* Unprintable characters become question marks. Bit 31 means big-endian. */
char *video_fourcc_name(guint32 fourcc) {
    char name[5] = {0};
    for (int i = 0; i < 4; i++) {
        char c = (char)(fourcc >> 8 * i & 0x7f);
        name[i] = (char)(g_ascii_isprint(c) ? c : '?');
    }
    g_strchomp(name);
    return g_strconcat(name, fourcc & 1u << 31 ? "-BE" : "", NULL);
}

gboolean video_fourcc_parse(const char *name, guint32 *ret_fourcc) {
    gsize n = strlen(name);
    if (n < 1 || n > 4)
        return FALSE;
    guint32 fourcc = 0;
    for (gsize i = 0; i < 4; i++)
        fourcc |= (guint32)(guint8)(i < n ? name[i] : ' ') << 8 * i;
    *ret_fourcc = fourcc;
    return TRUE;
}

gsize video_format_row_bytes(const struct video_format *format, int width) {
    gsize n = (gsize)width;
    switch (format->packing) {
    case VIDEO_BYTES:
        return n;
    case VIDEO_MIPI10:
        return (n + 3) / 4 * 5;
    case VIDEO_MIPI12:
        return (n + 1) / 2 * 3;
    case VIDEO_YUYV:
    case VIDEO_UYVY:
        return (n + 1) / 2 * 4;
    default:
        return n * 2;
    }
}

gsize video_format_bytes(const struct video_format *format, int width, int height, gsize stride) {
    return stride * (gsize)(height - 1) + video_format_row_bytes(format, width);
}

static void unpack_bytes(const guint8 *from, int width, int step, guint16 *to) {
    for (int x = 0; x < width; x++)
        to[x] = from[x * step];
}

static void unpack_row(const struct video_format *format, const guint8 *from, int width,
                       guint16 *to) {
    const guint8 *group;
    guint16 most = (guint16)((1u << format->bits) - 1);
    switch (format->packing) {
    case VIDEO_BYTES:
        unpack_bytes(from, width, 1, to);
        break;
    case VIDEO_WORDS:
        for (int x = 0; x < width; x++) {
            guint16 value = (guint16)(from[2 * x] | from[2 * x + 1] << 8);
            to[x] = MIN(value, most);
        }
        break;
    case VIDEO_MIPI10:
        for (int x = 0; x < width; x++) {
            group = from + x / 4 * 5;
            to[x] = (guint16)(group[x % 4] << 2 | (group[4] >> x % 4 * 2 & 3));
        }
        break;
    case VIDEO_MIPI12:
        for (int x = 0; x < width; x++) {
            group = from + x / 2 * 3;
            to[x] = (guint16)(group[x % 2] << 4 | (group[2] >> x % 2 * 4 & 15));
        }
        break;
    case VIDEO_YUYV:
        unpack_bytes(from, width, 2, to);
        break;
    case VIDEO_UYVY:
        unpack_bytes(from + 1, width, 2, to);
        break;
    }
}

void video_format_unpack(const struct video_format *format, const guint8 *from, gsize stride,
                         int width, int height, guint16 *ret_pixels) {
    for (int y = 0; y < height; y++)
        unpack_row(format, from + (gsize)y * stride, width, ret_pixels + (gsize)y * (gsize)width);
}
