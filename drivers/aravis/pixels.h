/* Pixel formats of GenICam cameras that can be used for measuring: raw values of one channel per
 * pixel. */
#pragma once

#include "drivers/frame.h"

enum aravis_packing {
    ARAVIS_BYTES, /* one byte per pixel */
    ARAVIS_WORDS, /* two bytes per pixel, little endian */
    ARAVIS_10P,   /* four pixels in five bytes, lowest bits first */
    ARAVIS_12P,   /* two pixels in three bytes, lowest bits first */
    /* Two pixels in three bytes: the low bits of both lie between their high bytes. */
    ARAVIS_PACKED,
};

struct aravis_format {
    const char *name; /* value of the camera's feature PixelFormat */
    guint32 code;     /* code by the Pixel Format Naming Convention */
    enum cfa cfa;
    int bits; /* bits of a value */
    enum aravis_packing packing;
};

/* Both return the format with a name or a code, or NULL if it cannot be used for measuring. */
const struct aravis_format *aravis_format_by_name(const char *name);
const struct aravis_format *aravis_format_by_code(guint32 code);

/* All formats that can be used for measuring, the best first. The last entry has a NULL name. */
extern const struct aravis_format aravis_formats[];

/* Returns the number of bytes in which a camera sends a frame. */
gsize aravis_format_bytes(const struct aravis_format *format, int width, int height);

/* Unpacks n pixels to one value each. `from` points to as many bytes as aravis_format_bytes()
 * returns for n pixels. `to` has room for n values. */
void aravis_unpack(const struct aravis_format *format, const guint8 *from, gsize n, guint16 *to);
