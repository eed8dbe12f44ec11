/*
 * Normal maps from files, in tangent space with +y upwards, as in glTF:
 *   PNG, 8 or 16 bits, in colour: red, green, blue of 0 … 1 are x, y, z of −1 … 1, without gamma
 *   EXR: the part "normal", or else the first part; channels X, Y, Z of −1 … 1 (as in the files of
 *        “mesorig compress --method ward”), or R, G, B with the coding of a PNG
 */
#pragma once

#include <glib.h>

#define NORMAL_MAP_ERROR normal_map_error_quark()
GQuark normal_map_error_quark(void);
enum normal_map_error {
    NORMAL_MAP_ERROR_IO,
    /* The file cannot be decoded, or is no normal map. If texels are wrong, the message names the
     * first of them. */
    NORMAL_MAP_ERROR_FORMAT,
};

#define NORMAL_MAP_MAX 16384 /* largest number of texels in each direction */

struct normal_map {
    int width, height;
    float *xy; /* x and y of unit normals, row 0 at the top: height × width × 2 */
};

/* Reads a normal map. Any thread may call it. */
struct normal_map *normal_map_read(const char *path, GError **error);
void normal_map_free(struct normal_map *map); /* NULL is ignored */
