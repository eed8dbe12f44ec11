/*
 * The views of an MDF in fewer bits, each view by itself as in Wang et al. 2005. The file is
 * products/mdf.exr (pipeline.h) with channel D alone, in half floats: the distances, or whole
 * numbers 0 … 255, which the view's attribute mesorig.scale_mm (double) multiplies to give
 * millimetres. −1: no laser saw the texel. mdf_table_read() reads both.
 */
#pragma once

#include <gio/gio.h>

enum mdf_packed { MDF_PACKED_HALF, MDF_PACKED_8BIT };

/* Packs file from into file to. ret_bytes: of its texels and scales. Any thread. */
gboolean mdf_pack(const char *from, const char *to, enum mdf_packed kind, gint64 *ret_bytes,
                  GError **error);

/* What an EXR of distances holds: views, measured or packed; factors (mdf_factors.h); or blocks
 * (mdf_blocks.h). A file that cannot be read counts as MDF_KIND_VIEWS, since reading it then gives
 * the error. */
enum mdf_kind { MDF_KIND_VIEWS, MDF_KIND_FACTORS, MDF_KIND_BLOCKS };
enum mdf_kind mdf_kind(const char *path);
