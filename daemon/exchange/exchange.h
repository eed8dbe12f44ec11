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

/* What an export writes. */
struct exchange_format {
    const char *what;   /* the plural of the product, for instance "BTFs" */
    const char *format; /* as in "Bonn's format" */
    const char *end;    /* of the file's name, with the dot; NULL: any */
    const char *kind;   /* of output_file.h; NULL: the format has no room for it */
};

/* Checks -o: NULL if it is missing, does not end as files of its format do, or exists and may not
 * be replaced (output_file.h). */
OutputFile *exchange_output(const char *output, const struct exchange_format *format,
                            GError **error);
/* The same for a folder of several files; see cli_check_folder(). */
gboolean exchange_check_folder(const char *output, GError **error);

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
