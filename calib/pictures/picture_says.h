/*
 * What a picture's file says of itself, other than its pixels: its tone curve, whether pixels may
 * be transparent, and when it was taken. PNG (cICP, iCCP, sRGB, gAMA, tRNS, eXIf), JPEG (ICC
 * profile, EXIF), TIFF and camera raw that has its form (ICC profile, EXIF). Any thread.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* How a number, 1 being white, stands for light. */
enum picture_tones {
    PICTURE_TONES_UNSAID,
    PICTURE_TONES_LINEAR,
    PICTURE_TONES_SRGB,  /* IEC 61966-2-1 */
    PICTURE_TONES_GAMMA, /* light = number ^ gamma */
    PICTURE_TONES_CURVE, /* of an ICC profile, or of BT.709 */
    PICTURE_TONES_OTHER, /* said, but no curve that is known here (PQ, HLG, a profile of tables) */
};

struct picture_tone {
    enum picture_tones tones;
    double gamma;
    float *curve; /* the light of PICTURE_CURVE equidistant numbers from 0 to 1 */
    char *said;   /* where the file says it, "PNG gAMA 0.45455"; NULL: PICTURE_TONES_UNSAID */
};
#define PICTURE_CURVE 65536 /* each number of 8 or 16 bits is one of them */

struct picture_says {
    struct picture_tone tone;
    gboolean alpha;  /* pixels may be transparent */
    gint64 taken_us; /* when the shutter opened, by the camera's clock; 0: it is not said */
};

/* Never fails: what is damaged is not said. */
void picture_says_read(const guint8 *bytes, gsize length, struct picture_says *ret);
void picture_says_clear(struct picture_says *says);

/* The same for a file, all unsaid if it cannot be read. */
void picture_says_read_file(const char *path, struct picture_says *ret);

/* The tone curve to take for numbers of 8, 16 or 0 bits (floating-point): wanted, if that is not
 * PICTURE_TONES_UNSAID; else what the file says; else sRGB of 8 bits, and linear of others.
 * Borrowed from said. NULL: PICTURE_FILE_ERROR_FAILED, the file says a curve that is not known
 * here. */
const struct picture_tone *picture_tone_choose(const struct picture_tone *said, int bits,
                                               enum picture_tones wanted, const char *path,
                                               GError **error);

/* The same in words: "sRGB, as the file says (PNG gAMA 0.45455)"; g_free(). */
char *picture_tone_describe(const struct picture_tone *said, int bits, enum picture_tones wanted);

/* Makes n numbers of 8, 16 or 0 bits linear, with white at 1. */
void picture_tone_apply(const struct picture_tone *tone, int bits, float *numbers, gsize n);

/* The light of a number, of which 1 is white. PICTURE_TONES_UNSAID and _OTHER are linear. */
double picture_tone_light(const struct picture_tone *tone, double number);

G_END_DECLS
