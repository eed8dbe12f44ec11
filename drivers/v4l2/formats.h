/*
 * Pixel formats of V4L2 that can be used for measuring, and their conversion to samples: mono and
 * Bayer of 8 to 16 bits, packed or in words, and the luma of YUYV and UYVY. Compressed formats
 * (MJPEG, H.264) cannot be used. The layouts are those of the kernel's "V4L2 pixel formats"
 * documentation. All functions are pure.
 */
#pragma once

#include "drivers/frame.h"

enum video_packing {
    VIDEO_BYTES, /* one byte per pixel */
    VIDEO_WORDS, /* two bytes per pixel, low byte first, value in the low bits */
    /* Four pixels in five bytes: their upper eight bits each, then the lower bits of all. */
    VIDEO_MIPI10,
    /* Two pixels in three bytes: their upper eight bits each, then the lower bits of both. */
    VIDEO_MIPI12,
    VIDEO_YUYV, /* luma in the even bytes */
    VIDEO_UYVY, /* luma in the odd bytes */
};

struct video_format {
    guint32 fourcc;
    enum cfa cfa;
    int bits;
    enum video_packing packing;
};

/* Returns the format with a code, or NULL if it cannot be used for measuring. */
const struct video_format *video_format_find(guint32 fourcc);

/* Returns the one of two formats that is better for measuring; any format is better than NULL.
 * Bayer is preferred to mono, and mono to luma. Among equals, more bits are better, then fewer
 * bytes. */
const struct video_format *video_format_better(const struct video_format *a,
                                               const struct video_format *b);

/* Returns the four characters of a code without trailing spaces, for example "RG10". A big-endian
 * format has "-BE" after them. Free the text with g_free(). */
char *video_fourcc_name(guint32 fourcc);

/* Converts one to four characters to a code. Returns FALSE if name is empty or longer. */
gboolean video_fourcc_parse(const char *name, guint32 *ret_fourcc);

gboolean video_format_is_luma(const struct video_format *format);

/* Returns the number of bytes of a row's pixels, without padding. */
gsize video_format_row_bytes(const struct video_format *format, int width);

/* Returns the number of bytes from the start of a frame to the end of its last sample. */
gsize video_format_bytes(const struct video_format *format, int width, int height, gsize stride);

/* Unpacks a frame into width × height samples. Successive rows of the frame begin stride bytes
 * apart. In a format of packing VIDEO_WORDS, a sample that exceeds the format's bits becomes the
 * largest value of these bits. */
void video_format_unpack(const struct video_format *format, const guint8 *from, gsize stride,
                         int width, int height, guint16 *ret_pixels);
