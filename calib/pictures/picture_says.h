/*
 * This module reads what a file says about its picture: the tone curve, whether pixels may be
 * transparent, when the picture was taken, and with which focal length. It reads PNG (cICP, iCCP,
 * sRGB, gAMA, tRNS, eXIf), JPEG (ICC profile, EXIF), and TIFF and camera raw of the same form (ICC
 * profile, EXIF). Any thread may call the functions.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* How a number, with white at 1, stands for light. */
enum picture_tones {
    PICTURE_TONES_UNSAID,
    PICTURE_TONES_LINEAR,
    PICTURE_TONES_SRGB,  /* IEC 61966-2-1 */
    PICTURE_TONES_GAMMA, /* light = number ^ gamma */
    PICTURE_TONES_CURVE, /* curve of an ICC profile, or of BT.709 */
    /* the file gives a curve that is not supported (PQ, HLG, a profile of tables) */
    PICTURE_TONES_OTHER,
};

struct picture_tone {
    enum picture_tones tones;
    /* exponent; only for PICTURE_TONES_GAMMA */
    double gamma;
    /* Table of linear light: entry i is for the pixel value i / (PICTURE_CURVE - 1), where 1 is
     * white. It is NULL if tones is not PICTURE_TONES_CURVE. */
    float *curve;
    /* where the file gives the curve, such as "PNG gAMA 0.45455"; NULL for PICTURE_TONES_UNSAID */
    char *said;
};
#define PICTURE_CURVE 65536 /* number of entries: each number of 8 or 16 bits has one */

struct picture_says {
    struct picture_tone tone;
    gboolean alpha; /* pixels may be transparent */
    /* Time when the picture was taken by the camera's clock, as if that clock showed UTC. It is
     * from the EXIF tag of this time or, if there is none, from the date among the file's TIFF
     * tags. It is 0 if neither is given, or if the tag that is used has no valid time. */
    gint64 taken_us;
    /* Focal length of the lens, and number of pixels per mm of the sensor in a picture whose longer
     * side has full_px pixels. Each is 0 if it is not given. full_px may be 0 although
     * pixels_per_mm is given. */
    double focal_mm, pixels_per_mm, full_px;
    double film_mm; /* focal length that gives the same picture on 35 mm film; 0 if not given */
};

/* Reads what the bytes of a file say. Statements that are damaged count as missing. Call
 * picture_says_clear() afterwards. */
void picture_says_read(const guint8 *bytes, gsize length, struct picture_says *ret);
void picture_says_clear(struct picture_says *says);

/* Returns the focal length in pixels of a picture of this size. *ret_said gets a text such as
 * "EXIF: 50 mm, 115.2 pixels per mm"; free it with g_free(). Returns 0, with NULL in *ret_said, if
 * the file gives no focal length from 0.1 to 200 times the longer side of the picture. EXIF gives
 * the focal length of a lens that is focused at infinity. With a lens that is focused on a near
 * object, the true focal length may differ by several per cent. */
double picture_says_focal_px(const struct picture_says *says, int width, int height,
                             char **ret_said);

/* Reads what the file at `path` says, like picture_says_read(). If the file cannot be read, all
 * statements count as missing. Call picture_says_clear() afterwards. */
void picture_says_read_file(const char *path, struct picture_says *ret);

/* Chooses the tone curve for numbers of 8 or 16 bits, or for floating-point numbers if bits is 0.
 * If `wanted` is PICTURE_TONES_LINEAR or PICTURE_TONES_SRGB, this curve is used. If `wanted` is
 * PICTURE_TONES_UNSAID, the curve of the file, `said`, is used. If the file gives no curve either,
 * 8 bits are taken as sRGB, and other numbers as linear.
 *
 * The result may be `said` itself. Returns NULL with PICTURE_FILE_ERROR_FAILED if the curve of the
 * file is to be used but is not supported (PICTURE_TONES_OTHER). */
const struct picture_tone *picture_tone_choose(const struct picture_tone *said, int bits,
                                               enum picture_tones wanted, const char *path,
                                               GError **error);

/* Returns the choice of picture_tone_choose() in words, such as "sRGB, as the file says (PNG gAMA
 * 0.45455)". Free it with g_free(). */
char *picture_tone_describe(const struct picture_tone *said, int bits, enum picture_tones wanted);

/* Makes n numbers linear in place, with white at 1. bits is 8 or 16 for numbers from 0 to 255 or to
 * 65535, which are limited to this range. bits is 0 for floating-point numbers with white at 1.
 * Numbers that are not finite are not changed. */
void picture_tone_apply(const struct picture_tone *tone, int bits, float *numbers, gsize n);

/* Returns the light of a number, with white at 1. PICTURE_TONES_UNSAID and _OTHER count as
 * linear. */
double picture_tone_light(const struct picture_tone *tone, double number);

G_END_DECLS
