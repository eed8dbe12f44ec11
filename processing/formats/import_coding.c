/* Converts the numbers in the files of a table to linear values v,
 *   v = T((n − d) / (2^bits − 1 − black)) · m / f.
 * n is the number that the file has for a pixel, and bits is the column of that name. With a dark
 * frame, d is the number of the same pixel in the dark frame, and black is the mean of the dark
 * frame. Without a dark frame, d and black are the black level. T is the transfer function
 * (picture_tone_choose()). f is the value of the same pixel in the flat field with the same coding,
 * and m the mean of the flat field around the middle of the picture. For floating-point numbers,
 * white is 1 instead of 2^bits − 1. */
#include "import_poses_private.h"

#include <gio/gio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"

#define MIDDLE 10 /* m is the mean over the middle 1/MIDDLE of a picture's width and height */

gboolean import_coding_read(const struct import_set *set, const TextTable *table, int index,
                            const char *folder, struct import_row *row, GError **error) {
    /* names of the values of enum picture_tones, in its order; an empty cell stands for the
     * first */
    static const char *const transfers[] = {"", "linear", "srgb"};
    struct import_coding *coding = &row->coding;
    const char *transfer = text_table_text(table, index, text_table_column(table, "transfer"));
    const char *flat = text_table_text(table, index, text_table_column(table, "flat_field"));
    const char *dark = text_table_text(table, index, text_table_column(table, "dark_frame"));
    double bits;
    if (!text_table_number(table, index, text_table_column(table, "black_level"), 0,
                           &coding->black_level, error) ||
        !text_table_number(table, index, text_table_column(table, "bits"), 0, &bits, error))
        return FALSE;
    if (!(coding->black_level >= 0))
        return data_error_fail(set->table, row->line, error,
                               "a black_level of %g is below 0; give what a pixel shows without "
                               "light",
                               coding->black_level);
    if (bits != 0 && !(bits >= 2 && bits <= 16 && bits == floor(bits)))
        return data_error_fail(
            set->table, row->line, error,
            "bits is %g; give 2 to 16, or leave it empty to use all bits of the file", bits);
    coding->bits = (int)bits;
    while (coding->transfer < G_N_ELEMENTS(transfers) &&
           strcmp(transfer, transfers[coding->transfer]) != 0)
        coding->transfer++;
    if (coding->transfer >= G_N_ELEMENTS(transfers))
        return data_error_fail(set->table, row->line, error,
                               "transfer “%s” is not known; choose from: linear, srgb", transfer);
    if (coding->transfer == PICTURE_TONES_UNSAID)
        coding->transfer = set->wish->transfer;
    coding->flat_path = *flat ? g_canonicalize_filename(flat, folder) : NULL;
    coding->dark_path = *dark ? g_canonicalize_filename(dark, folder) : NULL;
    if (coding->dark_path && coding->black_level != 0)
        return data_error_fail(set->table, row->line, error,
                               "there are a dark_frame and a black_level of %g; leave out one of "
                               "them",
                               coding->black_level);
    if (coding->dark_path && !g_file_test(coding->dark_path, G_FILE_TEST_IS_REGULAR))
        return data_error_fail(
            set->table, row->line, error,
            "dark_frame names the file %s, which does not exist; correct the path",
            coding->dark_path);
    return !coding->flat_path || g_file_test(coding->flat_path, G_FILE_TEST_IS_REGULAR) ||
           data_error_fail(set->table, row->line, error,
                           "flat_field names the file %s, which does not exist; correct the path",
                           coding->flat_path);
}

/* Returns the number that a white pixel has in a file with this many bits (0 means floating-point).
 * black is the number that a pixel without light has. Returns 0 with an error if black is not below
 * white, or if the row states more bits than the file has. */
static double import_coding_white(const struct import_set *set, const struct import_row *row,
                                  const char *name, int bits, double black, GError **error) {
    const struct import_coding *coding = &row->coding;
    if (coding->bits > bits && bits == 0)
        data_error_set(set->table, row->line, error,
                       "bits is %d, but %s contains floating-point numbers; leave bits empty",
                       coding->bits, name);
    else if (coding->bits > bits)
        data_error_set(
            set->table, row->line, error,
            "bits is %d, but the numbers of %s have %d bits; give at most %d, or leave bits empty",
            coding->bits, name, bits, bits);
    if (coding->bits > bits)
        return 0;
    const double white = bits ? (double)((1 << (coding->bits ? coding->bits : bits)) - 1) : 1;
    if (black < white)
        return white;
    data_error_set(set->table, row->line, error,
                   coding->dark_path
                       ? "the mean of the dark frame is %g, but must be below white, which is %g "
                         "in %s; take the dark frame without light"
                       : "black_level is %g, but must be below white, which is %g in %s; give what "
                         "a pixel of this file shows without light",
                   black, white, name);
    return 0;
}

/* A dark frame, and the mean of its numbers. */
struct dark {
    struct import_picture *picture;
    double mean;
};

void import_coding_free_dark(gpointer data) {
    struct dark *dark = data;
    import_picture_free(dark->picture);
    g_free(dark);
}

static struct dark *read_dark(const char *path, GError **error) {
    struct import_picture *picture = import_picture_read_codes(path, error);
    double sum = 0;
    if (!picture)
        return NULL;
    const gsize n = 3 * (gsize)picture->width * (gsize)picture->height;
    for (gsize i = 0; i < n; i++)
        sum += (double)picture->rgb[i];
    struct dark *dark = g_new(struct dark, 1);
    *dark = (struct dark){picture, sum / (double)n};
    return dark;
}

/* Returns the dark frame of a row, which the set owns, or NULL with an error. The dark frame must
 * have the size and format of picture. */
static const struct dark *dark_frame(const struct import_set *set, const struct import_row *row,
                                     const struct import_picture *picture, const char *name,
                                     GError **error) {
    const char *path = row->coding.dark_path;
    g_autoptr(GError) found = NULL;
    struct dark *dark = g_hash_table_lookup(set->darks, path);
    if (!dark && (dark = read_dark(path, &found)))
        g_hash_table_insert(set->darks, g_strdup(path), dark);
    if (!dark) {
        data_error_set(set->table, row->line, error, "%s", found->message);
        return NULL;
    }
    const struct import_picture *of = dark->picture;
    if (of->width == picture->width && of->height == picture->height && of->grey == picture->grey &&
        of->bits == picture->bits)
        return dark;
    data_error_set(set->table, row->line, error,
                   "the dark frame %s (%d × %d pixels, %s, %d bits) and %s (%d × %d pixels, %s, %d "
                   "bits) do not match; give a dark frame with the size and format of the picture",
                   path, of->width, of->height, of->grey ? "grey" : "colour", of->bits, name,
                   picture->width, picture->height, picture->grey ? "grey" : "colour",
                   picture->bits);
    return NULL;
}

/* Reads a picture and converts its numbers with the coding of a row. Returns NULL with an error if
 * this is not possible. */
static struct import_picture *decode(const struct import_set *set, const struct import_row *row,
                                     const char *path, GError **error) {
    const struct rig_camera *camera = &set->known->rig.cameras[row->camera];
    const struct import_coding *coding = &row->coding;
    const char *name = path == row->path ? row->name : path;
    g_autoptr(GError) found = NULL;
    g_autoptr(ImportPicture) picture = import_picture_read_codes(path, &found);
    const struct picture_tone *tone =
        picture ? picture_tone_choose(&picture->tone, picture->bits, coding->transfer, path, &found)
                : NULL;
    if (!tone) {
        data_error_set(set->table, row->line, error, "%s", found->message);
        return NULL;
    }
    const int bits = picture->bits;
    if (picture->width != camera->width || picture->height != camera->height) {
        data_error_set(set->table, row->line, error,
                       "%s has %d × %d pixels, but camera %s has %d × %d in %s; give uncropped "
                       "pictures, or the calibration of the camera that took them",
                       name, picture->width, picture->height, camera->name, camera->width,
                       camera->height, set->wish->calibration);
        return NULL;
    }
    if (*picture->cfa && strcmp(picture->cfa, set->wish->cfa) != 0) {
        data_error_set(set->table, row->line, error,
                       "the colour filter of %s is %s, not %s; give --cfa %s", name, picture->cfa,
                       set->wish->cfa, picture->cfa);
        return NULL;
    }
    const struct dark *dark = NULL;
    if (coding->dark_path && !(dark = dark_frame(set, row, picture, name, error)))
        return NULL;
    const double black = dark ? dark->mean : coding->black_level;
    const double white = import_coding_white(set, row, name, bits, black, error);
    if (white == 0)
        return NULL;
    const gsize n = 3 * (gsize)picture->width * (gsize)picture->height;
    for (gsize i = 0; i < n; i++) {
        const double number = (double)picture->rgb[i];
        const double v =
            (number - (dark ? (double)dark->picture->rgb[i] : black)) / (white - black);
        if (bits && number > white) {
            data_error_set(
                set->table, row->line, error,
                "%s has a pixel of %g, but the largest number of %d bits is %g; write a larger "
                "number in the column bits",
                name, number, coding->bits, white);
            return NULL;
        }
        picture->rgb[i] = (float)picture_tone_light(tone, v);
    }
    return g_steal_pointer(&picture);
}

struct import_picture *import_coding_picture(const struct import_set *set,
                                             const struct import_row *row, GError **error) {
    return decode(set, row, row->path, error);
}

/* Converts a flat field to factors m / f. f is the value of a pixel and m the mean in the middle of
 * the picture. Each colour has its own m, and so has each place in the 2 × 2 cells of a colour
 * filter. Colours therefore keep their balance. */
static void invert(struct import_picture *flat, gboolean mosaic) {
    double sum[4][3] = {{0}};
    int n[4] = {0};
    const int width = flat->width, height = flat->height;
    const int reach_x = MAX(width / MIDDLE / 2, 1), reach_y = MAX(height / MIDDLE / 2, 1);
    for (int y = MAX(height / 2 - reach_y, 0); y < MIN(height / 2 + reach_y, height); y++)
        for (int x = MAX(width / 2 - reach_x, 0); x < MIN(width / 2 + reach_x, width); x++) {
            const int cell = mosaic ? 2 * (y & 1) + (x & 1) : 0;
            if (!isfinite(flat->rgb[3 * (y * width + x)]))
                continue;
            n[cell]++;
            for (int c = 0; c < 3; c++)
                sum[cell][c] += (double)flat->rgb[3 * (y * width + x) + c];
        }
    for (int i = 0; i < width * height; i++)
        for (int c = 0; c < 3; c++) {
            const int cell = mosaic ? 2 * (i / width & 1) + (i % width & 1) : 0;
            float *value = &flat->rgb[3 * i + c];
            *value = *value > 0 ? (float)(sum[cell][c] / n[cell] / (double)*value) : NAN;
        }
}

gboolean import_coding_flatten(const struct import_set *set, const struct import_row *row,
                               struct import_picture *picture, GError **error) {
    const struct import_coding *coding = &row->coding;
    const struct rig_camera *camera = &set->known->rig.cameras[row->camera];
    if (!coding->flat_path)
        return TRUE;
    if (camera->vignetting != 0 || set->known->camera_radiometry[row->camera].known)
        return data_error_fail(set->table, row->line, error,
                               "there is a flat_field, but %s also describes the vignetting of "
                               "camera %s; leave out one of them",
                               set->wish->calibration, camera->name);
    g_autofree char *key = g_strdup_printf(
        "%d %.17g %d %d %s\n%s", row->camera, coding->black_level, coding->bits,
        (int)coding->transfer, coding->flat_path, coding->dark_path ? coding->dark_path : "");
    struct import_picture *flat = g_hash_table_lookup(set->flats, key);
    if (!flat) {
        flat = decode(set, row, coding->flat_path, error);
        if (!flat)
            return FALSE;
        invert(flat, flat->grey && strcmp(set->wish->cfa, "mono") != 0);
        g_hash_table_insert(set->flats, g_steal_pointer(&key), flat);
    }
    if (picture->grey && !flat->grey)
        return data_error_fail(
            set->table, row->line, error,
            "%s is grey, but its flat field %s is in colour; give a grey flat field", row->name,
            coding->flat_path);
    const gsize n = 3 * (gsize)picture->width * (gsize)picture->height;
    for (gsize i = 0; i < n; i++)
        picture->rgb[i] *= flat->rgb[i];
    return TRUE;
}
