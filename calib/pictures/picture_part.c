#include "picture_part.h"

#include <glib/gstdio.h>
#include <math.h>
#include <png.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/input_file.h"

#define HEADER 29 /* bytes up to the interlace method */
/* number of bytes at the beginning of a file that are searched for the tone curve */
#define SAID    (4 << 20)
#define MAX_ROW (64 << 20) /* largest number of bytes of a row */

struct part_reading {
    FILE *file;
    const struct picture_part *part;
    guint8 *row, *rows; /* row: one whole row of the picture; rows: the part */
    gsize pixel;        /* bytes of a pixel */
    int channels, bits;
    /* first error of libpng; NULL if there was none */
    char *why;
};

static guint32 number_of(const guint8 *bytes) {
    return (guint32)bytes[0] << 24 | (guint32)bytes[1] << 16 | (guint32)bytes[2] << 8 | bytes[3];
}

gboolean picture_part_can(const char *path, int *ret_width, int *ret_height) {
    guint8 head[HEADER];
    const int fd = input_file_open(path, G_MAXINT64, NULL, NULL);
    if (fd < 0)
        return FALSE;
    const gboolean read = input_file_read_at(fd, path, head, HEADER, 0, NULL);
    close(fd);
    if (!read || png_sig_cmp(head, 0, 8) != 0 || memcmp(head + 12, "IHDR", 4) != 0 || head[28] != 0)
        return FALSE;
    const guint32 width = number_of(head + 16), height = number_of(head + 20);
    *ret_width = (int)width;
    *ret_height = (int)height;
    return width > 0 && width <= PNG_UINT_31_MAX && height > 0 && height <= PNG_UINT_31_MAX;
}

static void on_error(png_structp png, png_const_charp text) {
    struct part_reading *reading = png_get_error_ptr(png);
    if (!reading->why)
        reading->why = g_strdup_printf("%s; copy the file again", text);
    png_longjmp(png, 1);
}

static void on_warning(png_structp png, png_const_charp text) {
}

/* Ends the decoding with this error. */
G_NORETURN static void give_up(png_structp png, const char *why) {
    struct part_reading *reading = png_get_error_ptr(png);
    reading->why = g_strdup(why);
    png_longjmp(png, 1);
}

/* Decodes the rows. libpng may leave this function with longjmp(), so all memory is owned by
 * `reading`. */
static gboolean decode_rows(png_structp png, png_infop info, struct part_reading *reading) {
    const struct picture_part *part = reading->part;
    if (setjmp(png_jmpbuf(png)))
        return FALSE;
    png_init_io(png, reading->file);
    png_set_user_limits(png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
    png_read_info(png, info);
    png_set_expand(png);
    if (G_BYTE_ORDER == G_LITTLE_ENDIAN)
        png_set_swap(png);
    png_read_update_info(png, info);
    const gsize row = png_get_rowbytes(png, info);
    reading->channels = png_get_channels(png, info);
    reading->bits = png_get_bit_depth(png, info);
    reading->pixel = (gsize)reading->channels * (gsize)reading->bits / 8;
    if (row > MAX_ROW)
        give_up(png, "a row needs more than 64 MiB; cut the picture into narrower ones");
    reading->row = g_malloc(row);
    reading->rows = g_try_malloc0_n((gsize)part->width * (gsize)part->height, reading->pixel);
    if (!reading->rows)
        give_up(png, "there is too little memory for this part; close other programs");
    const gsize bytes = (gsize)part->width * reading->pixel;
    for (int y = 0; y < part->y + part->height; y++) {
        png_read_row(png, reading->row, NULL);
        if (y >= part->y)
            memcpy(reading->rows + bytes * (gsize)(y - part->y),
                   reading->row + (gsize)part->x * reading->pixel, bytes);
    }
    return TRUE;
}

static float part_number(const struct part_reading *from, gsize k) {
    return from->bits == 8 ? from->rows[k] : ((const guint16 *)(gconstpointer)from->rows)[k];
}

static void take_numbers(const struct part_reading *from, struct picture_codes *ret) {
    const gsize n = (gsize)from->part->width * (gsize)from->part->height;
    const gsize channels = (gsize)from->channels;
    const gboolean alpha = channels == 2 || channels == 4;
    const float opaque = (float)((1 << from->bits) - 1);
    ret->width = from->part->width;
    ret->height = from->part->height;
    ret->grey = channels < 3;
    ret->bits = from->bits;
    ret->rgb = g_new(float, 3 * n);
    for (gsize i = 0; i < n; i++) {
        const gboolean seen = !alpha || part_number(from, channels * i + channels - 1) >= opaque;
        ret->transparent += !seen;
        for (gsize c = 0; c < 3; c++)
            ret->rgb[3 * i + c] =
                seen ? part_number(from, channels * i + (ret->grey ? 0 : c)) : NAN;
    }
}

/* Reads the tone curve and the other facts about the picture from the chunks before the pixels. */
static void read_says(const char *path, int fd, guint64 length, struct picture_says *ret) {
    const gsize n = (gsize)MIN(length, SAID);
    g_autofree guint8 *bytes = g_malloc(n);
    if (input_file_read_at(fd, path, bytes, n, 0, NULL))
        picture_says_read(bytes, n, ret);
}

gboolean picture_part_read(const char *path, const struct picture_part *part,
                           struct picture_codes *ret, GError **error) {
    struct part_reading reading = {.part = part};
    guint64 length = 0;
    *ret = (struct picture_codes){0};
    const int fd = input_file_open(path, G_MAXINT64, &length, error);
    if (fd < 0)
        return FALSE;
    if (!input_file_check_pixels(path, (guint64)part->width, (guint64)part->height, length,
                                 error)) {
        close(fd);
        return FALSE;
    }
    read_says(path, fd, length, &ret->says);
    reading.file = fdopen(fd, "rb");
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &reading, on_error, on_warning);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    const gboolean good = info && decode_rows(png, info, &reading);
    png_destroy_read_struct(&png, &info, NULL);
    fclose(reading.file);
    if (good)
        take_numbers(&reading, ret);
    else
        g_set_error(
            error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_FAILED,
            "%s: rows %d to %d cannot be read (%s); copy the file again if it is damaged, or "
            "close other programs if there is too little memory",
            path, part->y, part->y + part->height - 1,
            reading.why ? reading.why : "there is too little memory");
    if (!good)
        picture_says_clear(&ret->says);
    g_free(reading.row);
    g_free(reading.rows);
    g_free(reading.why);
    return good;
}
