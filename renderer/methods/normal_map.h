/*
 * Normal maps from files, in tangent space with +y upwards, as glTF has them:
 *   PNG, 8 or 16 bits, in colour: red, green, blue of 0 … 1 are x, y, z of −1 … 1, without gamma
 *   EXR: the part "normal", or else the first; channels X, Y, Z of −1 … 1 (as in what “mesorig
 *        compress --method ward” writes), or R, G, B coded as in a PNG
 */
#pragma once

#include <glib.h>

#define NORMAL_MAP_ERROR normal_map_error_quark()
GQuark normal_map_error_quark(void);
enum normal_map_error {
    NORMAL_MAP_ERROR_IO,
    NORMAL_MAP_ERROR_FORMAT, /* not read, or no normal map; the message says which texel is not */
};

#define NORMAL_MAP_MAX 16384 /* texels each way */

struct normal_map {
    int width, height;
    float *xy; /* of unit normals, row 0 at the top: height × width × 2 */
};

/* Any thread. */
struct normal_map *normal_map_read(const char *path, GError **error);
void normal_map_free(struct normal_map *map); /* NULL is ignored */
