#include "picture_says.h"

#include "base/input_file.h"
#include "base/srgb.h"
#include "picture.h"
#include "tiff_tags.h"

#include <gio/gio.h>
#include <lcms2.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define MAX_PROFILE (16 << 20)    /* largest number of bytes of an ICC profile */
#define ADOBE_GAMMA (563 / 256.0) /* gamma of Adobe RGB (1998) */
#define FILM_MM     43.2666       /* diagonal of 35 mm film, 36 × 24 mm */
/* Range of a focal length, in units of the longer side of the picture. A value outside of this
 * range is a mistake of the file. */
#define SHORTEST 0.1
#define LONGEST  200.0

enum {
    TAG_DATE = 306,
    TAG_EXTRA_SAMPLES = 338,
    TAG_ICC = 34675,
    TAG_EXIF = 34665,
    TAG_TAKEN = 36867,
    TAG_FOCAL_LENGTH = 37386,
    TAG_TAKEN_FRACTION = 37521,
    TAG_COLOUR_SPACE = 40961,
    TAG_WIDTH = 40962,
    TAG_HEIGHT = 40963,
    TAG_FOCAL_PLANE_RESOLUTION = 41486,
    TAG_FOCAL_PLANE_UNIT = 41488,
    TAG_FOCAL_LENGTH_FILM = 41989,
    TAG_GAMMA = 42240,
};

static void say(struct picture_tone *tone, enum picture_tones tones, char *said) {
    picture_says_clear(&(struct picture_says){.tone = *tone});
    *tone = (struct picture_tone){.tones = tones, .said = said};
}

static void say_gamma(struct picture_tone *tone, double gamma, char *said) {
    say(tone, gamma == 1 ? PICTURE_TONES_LINEAR : PICTURE_TONES_GAMMA, said);
    tone->gamma = gamma;
}

void picture_says_clear(struct picture_says *says) {
    g_clear_pointer(&says->tone.curve, g_free);
    g_clear_pointer(&says->tone.said, g_free);
}

/* Returns the light of a number, by the inverse of BT.709's curve. */
static double from_709(double v) {
    return v < 0.081 ? v / 4.5 : pow((v + 0.099) / 1.099, 1 / 0.45);
}

double picture_tone_light(const struct picture_tone *tone, double number) {
    switch (tone->tones) {
    case PICTURE_TONES_SRGB: /* the linear part continues below 0 */
        return srgb_decode(number);
    case PICTURE_TONES_GAMMA:
        return number > 0 ? pow(number, tone->gamma) : number;
    case PICTURE_TONES_CURVE: {
        if (!(number > 0 && number < 1))
            return number;
        const double at = number * (PICTURE_CURVE - 1);
        const gsize below = (gsize)at;
        return (double)tone->curve[below] +
               (at - (double)below) * ((double)tone->curve[below + 1] - (double)tone->curve[below]);
    }
    default:
        return number;
    }
}

/* Reads the curve for green or for grey of an ICC profile. The tones are PICTURE_TONES_OTHER if the
 * profile has no such curve. ret is not changed if the profile cannot be read. */
static void read_profile(const guint8 *bytes, gsize length, struct picture_tone *ret) {
    char name[80] = "";
    /* The context has no logger, so Little CMS prints nothing. */
    cmsContext context = cmsCreateContext(NULL, NULL);
    cmsHPROFILE profile = length <= MAX_PROFILE
                              ? cmsOpenProfileFromMemTHR(context, bytes, (cmsUInt32Number)length)
                              : NULL;
    if (profile) {
        cmsGetProfileInfoASCII(profile, cmsInfoDescription, "en", "US", name, sizeof name);
        const cmsToneCurve *curve = cmsReadTag(profile, cmsSigGreenTRCTag);
        if (!curve)
            curve = cmsReadTag(profile, cmsSigGrayTRCTag);
        char *said =
            g_strdup_printf("ICC profile%s%s%s", *name ? " “" : "", name, *name ? "”" : "");
        if (curve && cmsIsToneCurveLinear(curve))
            say(ret, PICTURE_TONES_LINEAR, said);
        else
            say(ret, curve ? PICTURE_TONES_CURVE : PICTURE_TONES_OTHER, said);
        if (ret->tones == PICTURE_TONES_CURVE) {
            ret->curve = g_new(float, PICTURE_CURVE);
            for (int i = 0; i < PICTURE_CURVE; i++)
                ret->curve[i] = cmsEvalToneCurveFloat(curve, (float)i / (PICTURE_CURVE - 1));
        }
        cmsCloseProfile(profile);
    }
    cmsDeleteContext(context);
}

/* Parses a time such as "2026:11:27 18:57:13", and a fraction of a second such as "042", which may
 * be NULL. Returns µs since 1970, as if the time were UTC, or 0 if the text is not a time. */
static gint64 parse_time(const struct tiff_value *time, const struct tiff_value *fraction) {
    int d[6];
    g_autofree char *text = g_strndup((const char *)time->at, (gsize)MIN(time->n, 32));
    if (sscanf(text, "%4d:%2d:%2d %2d:%2d:%2d", &d[0], &d[1], &d[2], &d[3], &d[4], &d[5]) != 6)
        return 0;
    g_autoptr(GDateTime) date = g_date_time_new_utc(d[0], d[1], d[2], d[3], d[4], d[5]);
    if (!date)
        return 0;
    double seconds = 0;
    if (fraction) {
        g_autofree char *digits = g_strndup((const char *)fraction->at, (gsize)MIN(fraction->n, 9));
        g_autofree char *decimal = g_strconcat("0.", digits, NULL);
        seconds = g_ascii_strtod(decimal, NULL);
    }
    return g_date_time_to_unix(date) * G_USEC_PER_SEC + (gint64)(seconds * G_USEC_PER_SEC);
}

/* Returns the first rational number of a tag, or 0 if there is none. */
static double find_rational(const struct tiff *tiff, guint64 directory, guint tag) {
    struct tiff_value value;
    if (!tiff_find(tiff, directory, tag, &value) || value.type != TIFF_RATIONAL)
        return 0;
    const double down = (double)tiff_number(value.at + 4, 4, tiff->big_endian);
    return down > 0 ? (double)tiff_number(value.at, 4, tiff->big_endian) / down : 0;
}

/* Reads the focal length. The unit of the resolution is an inch unless the file gives another. */
static void read_focal(const struct tiff *tiff, guint64 exif, struct picture_says *ret) {
    static const double mm[] = {25.4, 25.4, 25.4, 10, 1, 0.001};
    const guint64 unit = tiff_find_number(tiff, exif, TAG_FOCAL_PLANE_UNIT);
    ret->focal_mm = find_rational(tiff, exif, TAG_FOCAL_LENGTH);
    ret->pixels_per_mm = find_rational(tiff, exif, TAG_FOCAL_PLANE_RESOLUTION) /
                         mm[unit < G_N_ELEMENTS(mm) ? unit : 0];
    ret->full_px = (double)MAX(tiff_find_number(tiff, exif, TAG_WIDTH),
                               tiff_find_number(tiff, exif, TAG_HEIGHT));
    ret->film_mm = (double)tiff_find_number(tiff, exif, TAG_FOCAL_LENGTH_FILM);
}

double picture_says_focal_px(const struct picture_says *says, int width, int height,
                             char **ret_said) {
    const double longer_px = MAX(width, height);
    const double scale = says->full_px > 0 ? longer_px / says->full_px : 1;
    const double focal_px = says->focal_mm * says->pixels_per_mm * scale;
    const double film_px = says->film_mm / FILM_MM * hypot(width, height);
    *ret_said = NULL;
    if (focal_px > SHORTEST * longer_px && focal_px < LONGEST * longer_px) {
        *ret_said = g_strdup_printf("EXIF: %.4g mm, %.4g pixels per mm", says->focal_mm,
                                    says->pixels_per_mm * scale);
        return focal_px;
    }
    if (film_px > SHORTEST * longer_px && film_px < LONGEST * longer_px) {
        *ret_said = g_strdup_printf("EXIF: as %.0f mm on 35 mm film", says->film_mm);
        return film_px;
    }
    return 0;
}

/* Reads EXIF data (file is FALSE), a TIFF file, or a camera raw file of the same form. */
static void read_tiff(const guint8 *bytes, gsize length, gboolean file, struct picture_says *ret) {
    struct tiff tiff;
    struct tiff_value value, fraction;
    if (!tiff_is(bytes, length, &tiff))
        return;
    const guint64 first = tiff_first(&tiff);
    const guint64 exif = tiff_find_number(&tiff, first, TAG_EXIF);
    const guint64 space = exif ? tiff_find_number(&tiff, exif, TAG_COLOUR_SPACE) : 0;
    if (exif && tiff_find(&tiff, exif, TAG_TAKEN, &value) && value.type == TIFF_ASCII)
        ret->taken_us = parse_time(&value, tiff_find(&tiff, exif, TAG_TAKEN_FRACTION, &fraction) &&
                                                   fraction.type == TIFF_ASCII
                                               ? &fraction
                                               : NULL);
    else if (tiff_find(&tiff, first, TAG_DATE, &value) && value.type == TIFF_ASCII)
        ret->taken_us = parse_time(&value, NULL);
    if (exif)
        read_focal(&tiff, exif, ret);
    if (file) {
        for (guint64 i = 0; tiff_find(&tiff, first, TAG_EXTRA_SAMPLES, &value) && i < value.n; i++)
            ret->alpha |=
                tiff_number(value.at + i * (guint64)value.size, value.size, tiff.big_endian) != 0;
        if (tiff_find(&tiff, first, TAG_ICC, &value))
            read_profile(value.at, (gsize)value.n * (gsize)value.size, &ret->tone);
    }
    if (ret->tone.tones != PICTURE_TONES_UNSAID)
        return;
    if (exif && tiff_find(&tiff, exif, TAG_GAMMA, &value) && value.type == TIFF_RATIONAL) {
        const double up = (double)tiff_number(value.at, 4, tiff.big_endian);
        const double down = (double)tiff_number(value.at + 4, 4, tiff.big_endian);
        if (up > 0 && down > 0)
            say_gamma(&ret->tone, up / down, g_strdup_printf("EXIF gamma %.4g", up / down));
    } else if (space == 1) {
        say(&ret->tone, PICTURE_TONES_SRGB, g_strdup("EXIF sRGB"));
    } else if (space == 2) {
        say_gamma(&ret->tone, ADOBE_GAMMA, g_strdup("EXIF Adobe RGB"));
    }
}

static void read_jpeg(const guint8 *bytes, gsize length, struct picture_says *ret) {
    static const char exif[] = "Exif\0", icc[] = "ICC_PROFILE"; /* both with a NUL at the end */
    g_autoptr(GByteArray) profile = g_byte_array_new();
    for (gsize at = 2; at + 4 <= length && bytes[at] == 0xff;) {
        const guint8 marker = bytes[at + 1];
        if (marker == 0xff || marker == 0x01) {
            at += marker == 0xff ? 1 : 2;
            continue;
        }
        const gsize size = (gsize)tiff_number(bytes + at + 2, 2, TRUE);
        if (marker == 0xda || marker == 0xd9 || size < 2 || size > length - at - 2)
            break;
        const guint8 *data = bytes + at + 4;
        const gsize n = size - 2;
        if (marker == 0xe2 && n > sizeof icc + 2 && memcmp(data, icc, sizeof icc) == 0 &&
            profile->len < MAX_PROFILE) /* pieces of a profile, in order */
            g_byte_array_append(profile, data + sizeof icc + 2, (guint)(n - sizeof icc - 2));
        if (marker == 0xe1 && n > sizeof exif && memcmp(data, exif, sizeof exif) == 0)
            read_tiff(data + sizeof exif, n - sizeof exif, FALSE, ret);
        at += 2 + size;
    }
    if (profile->len > 0)
        read_profile(profile->data, profile->len, &ret->tone);
}

/* Reads the profile of a PNG's iCCP chunk, which has a name and the compressed profile. */
static void read_iccp(const guint8 *data, gsize n, struct picture_tone *ret) {
    const guint8 *end = memchr(data, 0, n);
    if (!end || (gsize)(data + n - end) < 3)
        return;
    g_autoptr(GZlibDecompressor) inflate = g_zlib_decompressor_new(G_ZLIB_COMPRESSOR_FORMAT_ZLIB);
    g_autoptr(GByteArray) profile = g_byte_array_new();
    guint8 piece[1 << 14];
    gsize used = 2;
    while (profile->len < MAX_PROFILE) {
        gsize read = 0, written = 0;
        const GConverterResult result = g_converter_convert(
            G_CONVERTER(inflate), end + used, (gsize)(data + n - end) - used, piece, sizeof piece,
            G_CONVERTER_INPUT_AT_END, &read, &written, NULL);
        if (result == G_CONVERTER_ERROR)
            return;
        used += read;
        g_byte_array_append(profile, piece, (guint)written);
        if (result == G_CONVERTER_FINISHED)
            read_profile(profile->data, profile->len, ret);
        if (result == G_CONVERTER_FINISHED || read + written == 0)
            return;
    }
}

/* Sets the tone curve of a PNG's cICP chunk. transfer is the number of the transfer characteristics
 * in ITU-T H.273. */
static void read_cicp(int transfer, struct picture_tone *ret) {
    char *said = g_strdup_printf("PNG cICP %d", transfer);
    if (transfer == 8)
        say(ret, PICTURE_TONES_LINEAR, said);
    else if (transfer == 13)
        say(ret, PICTURE_TONES_SRGB, said);
    else if (transfer == 4 || transfer == 5)
        say_gamma(ret, transfer == 4 ? 2.2 : 2.8, said);
    else if (transfer == 1 || transfer == 6 || transfer == 14 || transfer == 15) {
        say(ret, PICTURE_TONES_CURVE, said);
        ret->curve = g_new(float, PICTURE_CURVE);
        for (int i = 0; i < PICTURE_CURVE; i++)
            ret->curve[i] = (float)from_709((double)i / (PICTURE_CURVE - 1));
    } else
        say(ret, PICTURE_TONES_OTHER, said);
}

/* If a file has several statements, the one that the PNG standard prefers is used: cICP, iCCP,
 * sRGB, gAMA. */
static void read_png(const guint8 *bytes, gsize length, struct picture_says *ret) {
    struct picture_tone *tone = &ret->tone;
    int rank = 0;
    ret->alpha = length > 25 && (bytes[25] & 4) != 0; /* the colour type of IHDR */
    for (gsize at = 8; at + 12 <= length;) {
        const gsize n = (gsize)tiff_number(bytes + at, 4, TRUE);
        const guint8 *type = bytes + at + 4, *data = bytes + at + 8;
        if (n > length - at - 12)
            break;
        ret->alpha |= memcmp(type, "tRNS", 4) == 0;
        if (memcmp(type, "eXIf", 4) == 0) {
            /* The tone curve of EXIF does not count in a PNG. */
            struct picture_says exif = {.alpha = ret->alpha};
            read_tiff(data, n, FALSE, &exif);
            picture_says_clear(&exif);
            exif.tone = *tone;
            *ret = exif;
        } else if (memcmp(type, "cICP", 4) == 0 && n >= 4 && rank < 4) {
            read_cicp(data[1], tone);
            rank = 4;
        } else if (memcmp(type, "iCCP", 4) == 0 && rank < 3) {
            read_iccp(data, n, tone);
            rank = tone->said ? 3 : rank;
        } else if (memcmp(type, "sRGB", 4) == 0 && rank < 2) {
            say(tone, PICTURE_TONES_SRGB, g_strdup("PNG sRGB"));
            rank = 2;
        } else if (memcmp(type, "gAMA", 4) == 0 && n >= 4 && rank < 1 &&
                   tiff_number(data, 4, TRUE) > 0) {
            const double stored = (double)tiff_number(data, 4, TRUE) / 1e5;
            say_gamma(tone, 1 / stored, g_strdup_printf("PNG gAMA %g", stored));
            rank = 1;
        }
        at += 12 + n;
    }
}

void picture_says_read(const guint8 *bytes, gsize length, struct picture_says *ret) {
    *ret = (struct picture_says){0};
    if (length > 8 && memcmp(bytes, "\x89PNG\r\n\x1a\n", 8) == 0)
        read_png(bytes, length, ret);
    else if (length > 4 && bytes[0] == 0xff && bytes[1] == 0xd8)
        read_jpeg(bytes, length, ret);
    else
        read_tiff(bytes, length, TRUE, ret);
}

void picture_says_read_file(const char *path, struct picture_says *ret) {
    gsize length = 0;
    g_autofree char *bytes = input_file_read(path, G_MAXINT, &length, NULL);
    *ret = (struct picture_says){0};
    if (bytes)
        picture_says_read((const guint8 *)bytes, length, ret);
}

const struct picture_tone *picture_tone_choose(const struct picture_tone *said, int bits,
                                               enum picture_tones wanted, const char *path,
                                               GError **error) {
    static const struct picture_tone linear = {.tones = PICTURE_TONES_LINEAR},
                                     srgb = {.tones = PICTURE_TONES_SRGB};
    if (wanted == PICTURE_TONES_UNSAID && said->tones == PICTURE_TONES_OTHER) {
        g_set_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
                    "%s: the picture's tone curve (%s) is not supported; save the picture as sRGB "
                    "or linear, or state the curve with --transfer if the command has this option",
                    path, said->said);
        return NULL;
    }
    if (wanted == PICTURE_TONES_UNSAID && said->tones != PICTURE_TONES_UNSAID)
        return said;
    return wanted == PICTURE_TONES_SRGB || (wanted == PICTURE_TONES_UNSAID && bits == 8) ? &srgb
                                                                                         : &linear;
}

char *picture_tone_describe(const struct picture_tone *said, int bits, enum picture_tones wanted) {
    const struct picture_tone *tone = picture_tone_choose(said, bits, wanted, "", NULL);
    g_autofree char *name = !tone                                 ? g_strdup("not known")
                            : tone->tones == PICTURE_TONES_SRGB   ? g_strdup("sRGB")
                            : tone->tones == PICTURE_TONES_LINEAR ? g_strdup("linear")
                            : tone->tones == PICTURE_TONES_GAMMA
                                ? g_strdup_printf("to the power of %.4g", tone->gamma)
                                : g_strdup("by a curve");
    if (wanted != PICTURE_TONES_UNSAID)
        return said->said ? g_strdup_printf("%s, as asked for; the file says %s", name, said->said)
                          : g_strdup_printf("%s, as asked for", name);
    if (said->said)
        return g_strdup_printf("%s, as the file says (%s)", name, said->said);
    return bits ? g_strdup_printf("%s, assumed for %d bits because the file does not say", name,
                                  bits)
                : g_strdup_printf("%s, assumed for floating-point numbers", name);
}

void picture_tone_apply(const struct picture_tone *tone, int bits, float *numbers, gsize n) {
    const int white = bits ? (1 << bits) - 1 : 1;
    g_autofree float *table = bits ? g_new0(float, white + 1) : NULL;
    for (int i = 0; table && i <= white; i++)
        table[i] = (float)picture_tone_light(tone, (double)i / white);
    for (gsize i = 0; i < n; i++)
        if (!isfinite(numbers[i]))
            continue;
        else if (table)
            numbers[i] = table[CLAMP((int)numbers[i], 0, white)];
        else
            numbers[i] = (float)picture_tone_light(tone, (double)numbers[i]);
}
