/* The commands `mesorig import …` and `mesorig export …`: a file for each kind, or for kinds that
 * are alike, and a row of the table in import.c or exports.c. */
#pragma once

#include "command/cli.h"
#include "formats/import.h"

extern const struct command exchange_import, exchange_export;

/* The kinds of import, commands of `mesorig import`. */
extern const struct command exchange_import_btf, exchange_import_pictures, exchange_import_rti,
    exchange_import_relight, exchange_import_ptm, exchange_import_poses, exchange_import_bsdf,
    exchange_import_merl, exchange_import_utia;

/* The kinds of export, commands of `mesorig export`. */
extern const struct command exchange_btf, exchange_points, exchange_height, exchange_normals,
    exchange_web, exchange_maps, exchange_gltf, exchange_materialx, exchange_blender, exchange_bsdf,
    exchange_merl, exchange_ptm, exchange_relight;

/* Checks -o: FALSE if it is missing, does not end as files of its format do, or exists without
 * --force. what: the plural of what is written, for instance "BTFs"; format: as in "Bonn's format";
 * end: with the dot; NULL: any. */
gboolean exchange_check_output(const char *output, const char *what, const char *format,
                               const char *end, GError **error);

/* Reads --region: FALSE if the text is not X,Y,WIDTH,HEIGHT. */
gboolean exchange_parse_region(const char *text, struct import_region *ret);

/* Reads --transfer: FALSE if the text is neither NULL, linear nor srgb. */
gboolean exchange_parse_transfer(const char *text, enum picture_tones *ret);
#define EXCHANGE_TRANSFER_HELP                                                                     \
    "Tone curve of the pictures (as their files say; else sRGB of 8 bits, linear of others)"
#define EXCHANGE_TRANSFER_WRONG "there is no --transfer=%s; choose from: linear, srgb"

/* Says what was assumed and noticed. notes: of char *. */
void exchange_tell_notes(Record *to, const GPtrArray *notes);

/* Says what an import has made. */
void exchange_tell_import(Record *to, const char *session, const struct import_result *result,
                          double seconds);
