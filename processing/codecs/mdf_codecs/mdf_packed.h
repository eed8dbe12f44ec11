/*
 * The views of an MDF in fewer bits, each view by itself as in Wang et al. 2005. As
 * products/mdf.exr (pipeline.h), but channel D alone: half floats; or whole numbers 0 … 255 in
 * them, which times the view's attribute mesorig.scale_mm (double) are millimetres, −1: no laser
 * saw the texel. mdf_table_read() reads both.
 */
#pragma once

#include <gio/gio.h>

enum mdf_packed { MDF_PACKED_HALF, MDF_PACKED_8BIT };

/* Packs file from into file to. ret_bytes: of its texels and scales. Any thread. */
gboolean mdf_pack(const char *from, const char *to, enum mdf_packed kind, gint64 *ret_bytes,
                  GError **error);

/* What an EXR of distances holds: views, as measured or packed; maps, see mdf_factors.h; or
 * mdf_blocks.h's. Also MDF_KIND_VIEWS if it cannot be read: reading it then gives the error. */
enum mdf_kind { MDF_KIND_VIEWS, MDF_KIND_FACTORS, MDF_KIND_BLOCKS };
enum mdf_kind mdf_kind(const char *path);
