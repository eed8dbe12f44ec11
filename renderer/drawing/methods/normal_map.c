#include "normal_map.h"

#include "base/input_file.h"
#include "exr/exr.h"

#include <math.h>
#include <png.h>
#include <string.h>

/* Range of accepted lengths of normals. Filtering makes normals shorter, and noise makes them
 * longer. */
#define SHORTEST 0.5F
#define LONGEST  1.5F

G_DEFINE_QUARK(normal_map_error, normal_map_error)

void normal_map_free(struct normal_map *map) {
    if (map == NULL)
        return;
    g_free(map->xy);
    g_free(map);
}

static struct normal_map *normal_map_new(int width, int height) {
    struct normal_map *map = g_new0(struct normal_map, 1);
    map->width = width;
    map->height = height;
    map->xy = g_new(float, 2 * (gsize)width * height);
    return map;
}

/* Sets texel k to n, scaled to unit length. Fails if the length of n is not within SHORTEST …
 * LONGEST, or if n points into the surface or along it. */
static gboolean normal_map_put(struct normal_map *map, gsize k, const float n[3], const char *path,
                               GError **error) {
    const float length = sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    if (length >= SHORTEST && length <= LONGEST && n[2] > 0) {
        map->xy[2 * k] = n[0] / length;
        map->xy[2 * k + 1] = n[1] / length;
        return TRUE;
    }
    g_set_error(error, NORMAL_MAP_ERROR, NORMAL_MAP_ERROR_FORMAT,
                "%s: texel (%d, %d) is (%.3g, %.3g, %.3g), which is not the normal of a surface; "
                "choose a normal map in tangent space",
                path, (int)(k % (gsize)map->width), (int)(k / (gsize)map->width), (double)n[0],
                (double)n[1], (double)n[2]);
    return FALSE;
}

struct png_reading {
    const char *path;
    FILE *file;
    guint64 length;           /* length of the file, in bytes */
    int width, height, bytes; /* `bytes` is the number of bytes of a value */
    guint8 *rows;
    char *message;
    GError *why; /* set if decoding cannot begin */
};

static void normal_map_on_error(png_structp png, png_const_charp text) {
    struct png_reading *reading = png_get_error_ptr(png);
    g_free(reading->message);
    reading->message = g_strdup(text);
    png_longjmp(png, 1);
}

static void normal_map_on_warning(png_structp png, png_const_charp text) {
}

/* Decodes the PNG into reading->rows. All calls that may longjmp() are in this function, and so is
 * setjmp(). Memory that the function allocates is kept in reading, so that the caller can free it
 * after a longjmp(). */
static gboolean normal_map_decode(png_structp png, png_infop info, struct png_reading *reading) {
    if (setjmp(png_jmpbuf(png)))
        return FALSE;
    png_init_io(png, reading->file);
    png_set_user_limits(png, NORMAL_MAP_MAX, NORMAL_MAP_MAX);
    png_read_info(png, info);
    if (!input_file_check_pixels(reading->path, png_get_image_width(png, info),
                                 png_get_image_height(png, info), reading->length, &reading->why))
        return FALSE;
    if (!(png_get_color_type(png, info) & PNG_COLOR_MASK_COLOR)) {
        g_set_error(&reading->why, INPUT_FILE_ERROR, INPUT_FILE_ERROR_KIND,
                    "%s: the PNG is grey, but a normal map has three colours; choose another file",
                    reading->path);
        return FALSE;
    }
    png_set_expand(png);
    png_set_strip_alpha(png);
    const int passes = png_set_interlace_handling(png);
    png_read_update_info(png, info);
    reading->width = (int)png_get_image_width(png, info);
    reading->height = (int)png_get_image_height(png, info);
    reading->bytes = png_get_bit_depth(png, info) / 8;
    const gsize row = png_get_rowbytes(png, info);
    reading->rows = g_try_malloc0_n((gsize)reading->height, row);
    if (reading->rows == NULL) {
        g_set_error(&reading->why, INPUT_FILE_ERROR, INPUT_FILE_ERROR_TOO_LARGE,
                    "%s: there is not enough memory for the pixels; make the normal map smaller",
                    reading->path);
        return FALSE;
    }
    for (int pass = 0; pass < passes; pass++)
        for (int j = 0; j < reading->height; j++)
            png_read_row(png, reading->rows + row * (gsize)j, NULL);
    png_read_end(png, NULL);
    return TRUE;
}

static struct normal_map *normal_map_of_rows(const struct png_reading *reading, const char *path,
                                             GError **error) {
    struct normal_map *map = normal_map_new(reading->width, reading->height);
    const gsize n = (gsize)map->width * (gsize)map->height;
    for (gsize k = 0; k < n; k++) {
        float normal[3];
        for (gsize c = 0; c < 3; c++) {
            const guint8 *p = reading->rows + (3 * k + c) * (gsize)reading->bytes;
            normal[c] = reading->bytes == 2 ? (float)(256 * p[0] + p[1]) / 65535 * 2 - 1
                                            : (float)p[0] / 255 * 2 - 1;
        }
        if (!normal_map_put(map, k, normal, path, error)) {
            normal_map_free(map);
            return NULL;
        }
    }
    return map;
}

static struct normal_map *normal_map_read_png(const char *path, GError **error) {
    struct png_reading reading = {.path = path};
    struct normal_map *map = NULL;
    const int fd = input_file_open(path, G_MAXINT64, &reading.length, &reading.why);
    if (fd < 0) {
        input_file_propagate(reading.why, NORMAL_MAP_ERROR, NORMAL_MAP_ERROR_IO,
                             NORMAL_MAP_ERROR_FORMAT, error);
        return NULL;
    }
    reading.file = fdopen(fd, "rb");
    png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &reading, normal_map_on_error,
                                             normal_map_on_warning);
    png_infop info = png != NULL ? png_create_info_struct(png) : NULL;
    const gboolean good = info != NULL && normal_map_decode(png, info, &reading);
    png_destroy_read_struct(&png, &info, NULL);
    if (good)
        map = normal_map_of_rows(&reading, path, error);
    else if (reading.why != NULL)
        input_file_propagate(g_steal_pointer(&reading.why), NORMAL_MAP_ERROR, NORMAL_MAP_ERROR_IO,
                             NORMAL_MAP_ERROR_FORMAT, error);
    else
        g_set_error(error, NORMAL_MAP_ERROR, NORMAL_MAP_ERROR_FORMAT,
                    "%s cannot be read as a normal map: %s; save it again as a PNG", path,
                    reading.message != NULL ? reading.message : "PNG error");
    fclose(reading.file);
    g_free(reading.rows);
    g_free(reading.message);
    return map;
}

static gboolean normal_map_find_planes(const struct exr_part *part, const char *const names[3],
                                       const float *ret_planes[3]) {
    for (int c = 0; c < 3; c++)
        ret_planes[c] = exr_part_plane(part, names[c]);
    return ret_planes[0] != NULL && ret_planes[1] != NULL && ret_planes[2] != NULL;
}

static struct normal_map *normal_map_of_part(const struct exr_part *part, const char *path,
                                             GError **error) {
    static const char *const xyz[3] = {"X", "Y", "Z"}, *const rgb[3] = {"R", "G", "B"};
    const float *planes[3];
    const gboolean plain = normal_map_find_planes(part, xyz, planes);
    if (!plain && !normal_map_find_planes(part, rgb, planes)) {
        g_set_error(
            error, NORMAL_MAP_ERROR, NORMAL_MAP_ERROR_FORMAT,
            "%s has neither the channels X, Y, Z nor R, G, B of a normal map; choose another file",
            path);
        return NULL;
    }
    if (part->width > NORMAL_MAP_MAX || part->height > NORMAL_MAP_MAX) {
        g_set_error(error, NORMAL_MAP_ERROR, NORMAL_MAP_ERROR_FORMAT,
                    "%s has %d × %d texels, but a normal map has at most %d in each direction; "
                    "make the normal map smaller",
                    path, part->width, part->height, NORMAL_MAP_MAX);
        return NULL;
    }
    struct normal_map *map = normal_map_new(part->width, part->height);
    for (gsize k = 0; k < (gsize)map->width * (gsize)map->height; k++) {
        float normal[3];
        for (int c = 0; c < 3; c++)
            normal[c] = plain ? planes[c][k] : 2 * planes[c][k] - 1;
        if (!normal_map_put(map, k, normal, path, error)) {
            normal_map_free(map);
            return NULL;
        }
    }
    return map;
}

static struct normal_map *normal_map_read_exr(const char *path, GError **error) {
    struct exr_file *file = exr_read(path, error);
    if (file == NULL)
        return NULL;
    const struct exr_part *part = exr_file_part(file, "normal");
    if (part == NULL && file->parts->len > 0)
        part = file->parts->pdata[0];
    struct normal_map *map = part != NULL ? normal_map_of_part(part, path, error) : NULL;
    if (part == NULL)
        g_set_error(error, NORMAL_MAP_ERROR, NORMAL_MAP_ERROR_FORMAT,
                    "%s has no parts, so no normal map; save the normal map again", path);
    exr_file_free(file);
    return map;
}

struct normal_map *normal_map_read(const char *path, GError **error) {
    g_autofree char *lower = g_ascii_strdown(path, -1);
    return g_str_has_suffix(lower, ".exr") ? normal_map_read_exr(path, error)
                                           : normal_map_read_png(path, error);
}
