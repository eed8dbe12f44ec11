#include "pixels.h"

#define PHASES(suffix, n_bits, how, mono, rggb, bggr, grbg, gbrg)                                  \
    {"Mono" suffix, mono, CFA_MONO, n_bits, how}, {"BayerRG" suffix, rggb, CFA_RGGB, n_bits, how}, \
        {"BayerBG" suffix, bggr, CFA_BGGR, n_bits, how},                                           \
        {"BayerGR" suffix, grbg, CFA_GRBG, n_bits, how}, {                                         \
        "BayerGB" suffix, gbrg, CFA_GBRG, n_bits, how                                              \
    }

/* The formats stand in order of preference: more bits first, and among formats with the same number
 * of bits the more compact first. 16 bits stand after 12, because most cameras that offer both fill
 * 12 bits up with four zeros. */
const struct aravis_format aravis_formats[] = {
    PHASES("12p", 12, ARAVIS_12P, 0x010c0047, 0x010c0059, 0x010c0053, 0x010c0057, 0x010c0055),
    PHASES("12Packed", 12, ARAVIS_PACKED, 0x010c0006, 0x010c002b, 0x010c002d, 0x010c002a,
           0x010c002c),
    PHASES("12", 12, ARAVIS_WORDS, 0x01100005, 0x01100011, 0x01100013, 0x01100010, 0x01100012),
    PHASES("16", 16, ARAVIS_WORDS, 0x01100007, 0x0110002f, 0x01100031, 0x0110002e, 0x01100030),
    PHASES("10p", 10, ARAVIS_10P, 0x010a0046, 0x010a0058, 0x010a0052, 0x010a0056, 0x010a0054),
    PHASES("10Packed", 10, ARAVIS_PACKED, 0x010c0004, 0x010c0027, 0x010c0029, 0x010c0026,
           0x010c0028),
    PHASES("10", 10, ARAVIS_WORDS, 0x01100003, 0x0110000d, 0x0110000f, 0x0110000c, 0x0110000e),
    PHASES("8", 8, ARAVIS_BYTES, 0x01080001, 0x01080009, 0x0108000b, 0x01080008, 0x0108000a),
    {NULL},
};

const struct aravis_format *aravis_format_by_name(const char *name) {
    for (const struct aravis_format *f = aravis_formats; f->name; f++)
        if (g_str_equal(f->name, name))
            return f;
    return NULL;
}

const struct aravis_format *aravis_format_by_code(guint32 code) {
    for (const struct aravis_format *f = aravis_formats; f->name; f++)
        if (f->code == code)
            return f;
    return NULL;
}

gsize aravis_format_bytes(const struct aravis_format *format, int width, int height) {
    gsize bits = format->code >> 16 & 0xff;
    return ((gsize)width * (gsize)height * bits + 7) / 8;
}

static void unpack_10p(const guint8 *from, gsize n, guint16 *to) {
    for (gsize i = 0; i < n; i++) {
        const guint8 *at = from + i / 4 * 5 + i % 4;
        guint shift = (guint)(i % 4) * 2;
        to[i] = (guint16)((at[0] >> shift | at[1] << (8 - shift)) & 0x3ff);
    }
}

static void unpack_12p(const guint8 *from, gsize n, guint16 *to) {
    for (gsize i = 0; i + 1 < n; i += 2, from += 3) {
        to[i] = (guint16)(from[0] | (from[1] & 0xf) << 8);
        to[i + 1] = (guint16)(from[1] >> 4 | from[2] << 4);
    }
    if (n % 2)
        to[n - 1] = (guint16)(from[0] | (from[1] & 0xf) << 8);
}

static void unpack_pairs(const guint8 *from, gsize n, guint rest, guint16 *to) {
    guint mask = (1u << rest) - 1;
    for (gsize i = 0; i + 1 < n; i += 2, from += 3) {
        to[i] = (guint16)((guint)from[0] << rest | (from[1] & mask));
        to[i + 1] = (guint16)((guint)from[2] << rest | (from[1] >> 4 & mask));
    }
    if (n % 2)
        to[n - 1] = (guint16)((guint)from[0] << rest | (from[1] & mask));
}

void aravis_unpack(const struct aravis_format *format, const guint8 *from, gsize n, guint16 *to) {
    switch (format->packing) {
    case ARAVIS_BYTES:
        for (gsize i = 0; i < n; i++)
            to[i] = from[i];
        break;
    case ARAVIS_WORDS:
        for (gsize i = 0; i < n; i++)
            to[i] = (guint16)(from[2 * i] | from[2 * i + 1] << 8);
        break;
    case ARAVIS_10P:
        unpack_10p(from, n, to);
        break;
    case ARAVIS_12P:
        unpack_12p(from, n, to);
        break;
    case ARAVIS_PACKED:
        unpack_pairs(from, n, (guint)format->bits - 8, to);
        break;
    }
}
