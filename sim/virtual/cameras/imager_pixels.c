#include "imager_private.h"

#include <string.h>

/* Codes of the Pixel Format Naming Convention. The low two bytes of a code are the number of the
 * format. The next byte is the number of bits of a pixel in memory. The driver has a table of its
 * own, so that an error in either table is found. */
enum packing { WHOLE, WORD, P, PACKED };

struct kind {
    const char *name;
    int bits;
    enum packing packing;
    guint32 codes[5]; /* mono, rggb, bggr, grbg, gbrg */
};

static const struct kind kinds[] = {
    {"8", 8, WHOLE, {0x01080001, 0x01080009, 0x0108000b, 0x01080008, 0x0108000a}},
    {"10", 10, WORD, {0x01100003, 0x0110000d, 0x0110000f, 0x0110000c, 0x0110000e}},
    {"10p", 10, P, {0x010a0046, 0x010a0058, 0x010a0052, 0x010a0056, 0x010a0054}},
    {"10Packed", 10, PACKED, {0x010c0004, 0x010c0027, 0x010c0029, 0x010c0026, 0x010c0028}},
    {"12", 12, WORD, {0x01100005, 0x01100011, 0x01100013, 0x01100010, 0x01100012}},
    {"12p", 12, P, {0x010c0047, 0x010c0059, 0x010c0053, 0x010c0057, 0x010c0055}},
    {"12Packed", 12, PACKED, {0x010c0006, 0x010c002b, 0x010c002d, 0x010c002a, 0x010c002c}},
    {"16", 16, WORD, {0x01100007, 0x0110002f, 0x01100031, 0x0110002e, 0x01100030}},
};

static const char *const phases[] = {"Mono", "BayerRG", "BayerBG", "BayerGR", "BayerGB"};

static const struct kind *find(guint32 format, enum cfa cfa) {
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (kinds[i].codes[cfa] == format || kinds[i].codes[CFA_MONO] == format)
            return &kinds[i];
    return NULL;
}

gsize imager_payload(guint32 format, enum cfa cfa, int width, int height) {
    const struct kind *kind = find(format, cfa);
    return kind ? ((gsize)width * (gsize)height * (format >> 16 & 0xff) + 7) / 8 : 0;
}

guint32 imager_first_format(enum cfa cfa) {
    return kinds[0].codes[cfa];
}

void imager_append_formats(GString *xml, enum cfa cfa) {
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        g_string_append_printf(xml, "<EnumEntry Name=\"%s%s\"><Value>%u</Value></EnumEntry>\n",
                               phases[cfa], kinds[i].name, kinds[i].codes[cfa]);
}

void imager_pack(guint32 format, enum cfa cfa, const guint16 *pixels, gsize n, int bits,
                 guint8 *to) {
    const struct kind *kind = find(format, cfa);
    g_return_if_fail(kind);
    g_autofree guint16 *values = g_new(guint16, n);

    for (gsize i = 0; i < n; i++)
        values[i] = (guint16)(bits > kind->bits ? pixels[i] >> (bits - kind->bits)
                                                : pixels[i] << (kind->bits - bits));
    switch (kind->packing) {
    case WHOLE:
    case WORD:
        for (gsize i = 0; i < n; i++) {
            *to++ = (guint8)values[i];
            if (kind->packing == WORD)
                *to++ = (guint8)(values[i] >> 8);
        }
        break;
    /* The packing of GigE Vision: the high eight bits of the first pixel, the low bits of both
     * pixels, and the high eight bits of the second pixel. */
    case PACKED:
        for (gsize i = 0; i + 1 < n; i += 2) {
            guint low = kind->bits - 8u, rest = (1u << low) - 1;
            *to++ = (guint8)(values[i] >> low);
            *to++ = (guint8)((values[i] & rest) | (values[i + 1] & rest) << 4);
            *to++ = (guint8)(values[i + 1] >> low);
        }
        break;
    case P: /* all bits one after another, the lowest bit of each pixel first */
        memset(to, 0, (n * (gsize)kind->bits + 7) / 8);
        for (gsize at = 0; at < n * (gsize)kind->bits; at++) {
            guint bit = values[at / (gsize)kind->bits] >> at % (gsize)kind->bits & 1;
            to[at / 8] = (guint8)(to[at / 8] | bit << (at % 8));
        }
        break;
    }
}
