/* The commands `mesorig import …` and `mesorig export …`: a file for each kind of export, and a row
 * of the table in exports.c. */
#pragma once

#include "command/cli.h"

extern const struct command exchange_import, exchange_export;

/* The kinds of export, commands of `mesorig export`. */
extern const struct command exchange_btf, exchange_points, exchange_height, exchange_normals,
    exchange_maps, exchange_gltf, exchange_materialx, exchange_blender, exchange_web;

/* Of -o: FALSE if it is missing or does not end as files of its format do. what: the things that
 * are written, as in "BTFs"; format: as in "Bonn's format"; end: with the dot; NULL: any. */
gboolean exchange_check_output(const char *output, const char *what, const char *format,
                               const char *end, GError **error);
