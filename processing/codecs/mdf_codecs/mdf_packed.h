/* The views of an MDF with fewer bits per texel, each view packed separately as in Wang et al.
 * 2005. The file is like products/mdf.exr (pipeline.h) but has only the channel D, in half floats.
 * There are two kinds of values. With MDF_PACKED_HALF, a value is a distance in mm. With
 * MDF_PACKED_8BIT, a value is a whole number 0 … 255. The distance in mm is then this number times
 * the view's attribute mesorig.scale_mm (double). A value of −1 means that no laser saw the texel.
 * mdf_table_read() reads both kinds. */
#pragma once

#include <glib.h>

enum mdf_packed { MDF_PACKED_HALF, MDF_PACKED_8BIT };

/* Packs the file `from` into the file `to`. *ret_bytes is the number of bytes of the packed texels
 * and scales in memory. The error is EXR_ERROR_FORMAT if a view has no channel D, is packed
 * already, or has a distance that is not from −60000 to 60000 mm. Any thread. */
gboolean mdf_pack(const char *from, const char *to, enum mdf_packed kind, gint64 *ret_bytes,
                  GError **error);

/* Returns the form of an EXR of distances: views (measured or packed), factors (mdf_factors.h) or
 * blocks (mdf_blocks.h). Returns MDF_KIND_VIEWS for a file that cannot be read, because
 * mdf_table_read() then gives the error. */
enum mdf_kind { MDF_KIND_VIEWS, MDF_KIND_FACTORS, MDF_KIND_BLOCKS };
enum mdf_kind mdf_kind(const char *path);
