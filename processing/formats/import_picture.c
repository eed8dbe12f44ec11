#include "import_private.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/input_file.h"
#include "exr/exr.h"
#include "pictures/picture_part.h"
#include "pictures/picture_read.h"
#include "pictures/raw.h"
#include "pictures/vision.h"

#define OPAQUE 0.999F

void import_picture_free(struct import_picture *picture) {
    if (!picture)
        return;
    picture_says_clear(&(struct picture_says){.tone = picture->tone});
    g_free(picture->rgb);
    g_free(picture);
}

static gboolean has_end(const char *name, const char *const *ends) {
    g_autofree char *lower = g_ascii_strdown(name, -1);
    for (; *ends; ends++)
        if (g_str_has_suffix(lower, *ends))
            return TRUE;
    return FALSE;
}

gboolean import_is_picture(const char *name) {
    static const char *const ends[] = {".jpg", ".jpeg", ".png", ".tif", ".tiff", ".exr", NULL};
    return has_end(name, ends) || raw_is(name);
}

/* Copies the numbers of a mosaic as a grey picture. */
static void take_mosaic(struct import_picture *to, const struct picture *from, const char *cfa) {
    const gsize n = (gsize)from->width * (gsize)from->height;
    to->width = from->width;
    to->height = from->height;
    to->grey = TRUE;
    g_strlcpy(to->cfa, cfa, sizeof to->cfa);
    to->rgb = g_new(float, 3 * n);
    for (gsize i = 0; i < 3 * n; i++)
        to->rgb[i] = from->values[i / 3];
}

/* Makes one pixel of each 2 × 2 cell of a mosaic. Its green value is the mean of the two green
 * values of the cell. */
static void take_cells(struct import_picture *to, const struct picture *from, const char *cfa) {
    to->width = from->width / 2;
    to->height = from->height / 2;
    to->rgb = g_new0(float, 3 * (gsize)to->width * (gsize)to->height);
    for (int y = 0; y < 2 * to->height; y++)
        for (int x = 0; x < 2 * to->width; x++) {
            const char colour = cfa[2 * (y & 1) + (x & 1)];
            const int c = colour == 'r' ? 0 : colour == 'g' ? 1 : 2;
            to->rgb[3 * ((gsize)(y / 2) * (gsize)to->width + (gsize)(x / 2)) + (gsize)c] +=
                (c == 1 ? 0.5F : 1) * from->values[(gsize)y * (gsize)from->width + (gsize)x];
        }
}

static struct import_picture *read_raw(const char *path, gboolean mosaic, GError **error) {
    char cfa[RAW_CFA];
    g_autoptr(Picture) raw = raw_read(path, cfa, error);
    if (!raw)
        return NULL;
    struct import_picture *picture = g_new0(struct import_picture, 1);
    if (mosaic || strcmp(cfa, "mono") == 0)
        take_mosaic(picture, raw, cfa);
    else
        take_cells(picture, raw, cfa);
    picture->tone =
        (struct picture_tone){.tones = PICTURE_TONES_LINEAR, .said = g_strdup("camera raw")};
    return picture;
}

/* Finds the layer whose channels R, G and B are to be read. Returns the prefix of the channels'
 * names, which ends with a dot, or "" if they have no prefix. Returns NULL if no layer or several
 * layers have such channels. If several have, ret_layers lists their names. */
static char *find_layer(const struct exr_part *part, GString *ret_layers) {
    g_autofree char *found = NULL;
    int n = 0;
    if (exr_part_plane(part, "R") && exr_part_plane(part, "G") && exr_part_plane(part, "B"))
        return g_strdup("");
    for (int c = 0; c < part->n_channels; c++) {
        const char *name = part->channels[c];
        if (!g_str_has_suffix(name, ".R"))
            continue;
        g_autofree char *layer = g_strndup(name, strlen(name) - 1);
        g_autofree char *green = g_strconcat(layer, "G", NULL);
        g_autofree char *blue = g_strconcat(layer, "B", NULL);
        if (!exr_part_plane(part, green) || !exr_part_plane(part, blue))
            continue;
        g_string_append_printf(ret_layers, "%s%.*s", n++ ? ", " : "", (int)strlen(layer) - 1,
                               layer);
        g_free(found);
        found = g_steal_pointer(&layer);
    }
    return n == 1 ? g_steal_pointer(&found) : NULL;
}

static float *plane_of(const struct exr_part *part, const char *layer, const char *channel) {
    g_autofree char *name = g_strconcat(layer, channel, NULL);
    return exr_part_plane(part, name);
}

/* Makes a picture from the planes of an EXR. Pixels are masked (NaN) if they are not opaque or lie
 * outside the data window. */
static struct import_picture *take_exr(const struct exr_part *part, const float *const planes[3],
                                       const float *opacity, gboolean grey) {
    struct import_picture *picture = g_new0(struct import_picture, 1);
    const gsize n = (gsize)part->width * (gsize)part->height;
    picture->width = part->width;
    picture->height = part->height;
    picture->left_px = part->left_px;
    picture->top_px = part->top_px;
    picture->grey = grey;
    picture->transparent = opacity ? 0 : (gsize)part->outside;
    picture->rgb = g_new(float, 3 * n);
    for (gsize i = 0; i < n; i++) {
        const gboolean seen = !opacity || opacity[i] >= OPAQUE;
        picture->transparent += !seen;
        for (gsize c = 0; c < 3; c++)
            picture->rgb[3 * i + c] = seen ? planes[c][i] : NAN;
    }
    return picture;
}

static struct import_picture *read_exr(const char *path, GError **error) {
    g_autoptr(ExrPart) part = exr_read_picture(path, error);
    if (!part)
        return NULL;
    /* The pixels are in memory twice here, as planes and interleaved. */
    GStatBuf status;
    if (!input_file_check_pixels(path, (guint64)part->width, (guint64)part->height,
                                 g_stat(path, &status) == 0 ? (guint64)status.st_size : 0, error))
        return NULL;
    const float *grey = exr_part_plane(part, "Y");
    g_autoptr(GString) layers = g_string_new(NULL);
    g_autofree char *layer = grey ? NULL : find_layer(part, layers);
    if (!grey && !layer) {
        if (layers->len)
            data_error_set(
                path, 0, error,
                "the picture has several layers with R, G and B: %s; save it with only one of them",
                layers->str);
        else
            data_error_set(path, 0, error,
                           "the picture has neither the channels R, G and B nor Y; save it with "
                           "one of these sets of channels");
        return NULL;
    }
    const float *const planes[3] = {grey ? grey : plane_of(part, layer, "R"),
                                    grey ? grey : plane_of(part, layer, "G"),
                                    grey ? grey : plane_of(part, layer, "B")};
    return take_exr(part, planes, plane_of(part, layer ? layer : "", "A"), grey != NULL);
}

/* Reads a JPEG, PNG or TIFF. If part is not NULL and a part of the file can be read, reads only the
 * part; otherwise reads the whole picture. */
static struct import_picture *read_other(const char *path, const struct import_region *part,
                                         GError **error) {
    struct picture_codes codes;
    int width = 0, height = 0;
    const gboolean some = part && picture_part_can(path, &width, &height) &&
                          (part->width < width || part->height < height) && part->width <= width &&
                          part->x <= width - part->width && part->height <= height &&
                          part->y <= height - part->height;
    if (some ? !picture_part_read(
                   path, &(struct picture_part){part->x, part->y, part->width, part->height},
                   &codes, error)
             : !picture_read_codes(path, &codes, error))
        return NULL;
    struct import_picture *picture = g_new0(struct import_picture, 1);
    *picture = (struct import_picture){.width = some ? width : codes.width,
                                       .height = some ? height : codes.height,
                                       .part = some ? *part : (struct import_region){0},
                                       .grey = codes.grey,
                                       .bits = codes.bits,
                                       .transparent = codes.transparent,
                                       .rgb = codes.rgb,
                                       .tone = codes.says.tone};
    return picture;
}

/* Reads a picture. Camera raw is read as its mosaic if codes is TRUE. If `part` is not NULL and the
 * file allows to read a part, only this part is read. */
static struct import_picture *read_any(const char *path, gboolean codes,
                                       const struct import_region *part, GError **error) {
    g_autoptr(GError) found = NULL;
    struct import_picture *picture = has_end(path, (const char *const[]){".exr", NULL})
                                         ? read_exr(path, &found)
                                     : raw_is(path) ? read_raw(path, codes, &found)
                                                    : read_other(path, part, &found);
    if (picture && picture->part.width == 0)
        picture->part = (struct import_region){0, 0, picture->width, picture->height};
    if (!picture)
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID, "%s",
                    found ? found->message : "the picture cannot be read");
    return picture;
}

struct import_picture *import_picture_read(const char *path, enum picture_tones wanted,
                                           GError **error) {
    return import_picture_read_part(path, NULL, wanted, error);
}

struct import_picture *import_picture_read_part(const char *path, const struct import_region *part,
                                                enum picture_tones wanted, GError **error) {
    g_autoptr(ImportPicture) picture = read_any(path, FALSE, part, error);
    g_autoptr(GError) found = NULL;
    if (!picture)
        return NULL;
    const struct picture_tone *tone =
        picture_tone_choose(&picture->tone, picture->bits, wanted, path, &found);
    if (!tone) {
        g_set_error_literal(error, DATA_ERROR, DATA_ERROR_INVALID, found->message);
        return NULL;
    }
    if (picture->bits || picture->tone.said || wanted != PICTURE_TONES_UNSAID)
        picture_tone_apply(tone, picture->bits, picture->rgb,
                           3 * (gsize)picture->part.width * (gsize)picture->part.height);
    return g_steal_pointer(&picture);
}

struct import_picture *import_picture_read_codes(const char *path, GError **error) {
    return read_any(path, TRUE, NULL, error);
}

gboolean import_picture_check_same(const struct import_picture *first,
                                   const struct import_picture *second, const char *list, int line,
                                   const char *name, GError **error) {
    if (second->width != first->width || second->height != first->height)
        return data_error_fail(
            list, line, error,
            "%s has %d × %d pixels, but the first picture has %d × %d; give pictures of one size",
            name, second->width, second->height, first->width, first->height);
    return (second->left_px == first->left_px && second->top_px == first->top_px) ||
           data_error_fail(
               list, line, error,
               "the display window of %s begins at %d, %d, but that of the first picture begins at "
               "%d, %d; they show different parts of the scene, so crop all pictures alike",
               name, second->left_px, second->top_px, first->left_px, first->top_px);
}

gboolean import_picture_check_holes(const struct import_picture *picture, gsize n_bad,
                                    gsize n_pixels, const char *list, int line, const char *name,
                                    GError **error) {
    const gsize masked = MIN(picture->transparent, n_bad);
    g_autofree char *of = name ? g_strdup_printf("the %zu pixels of %s", n_pixels, name)
                               : g_strdup_printf("its %zu pixels", n_pixels);
    if ((double)n_bad > IMPORT_MAX_MASKED * (double)n_pixels && masked > 0)
        return data_error_fail(list, line, error,
                               "%zu of %s are masked or not numbers; remove the opacity channel if "
                               "these pixels show the sample",
                               n_bad, of);
    return (double)(n_bad - masked) <= IMPORT_MAX_HOLES * (double)(n_pixels - masked) ||
           data_error_fail(list, line, error,
                           "%zu of %s are not numbers; save the picture again, or leave it out",
                           n_bad, of);
}
