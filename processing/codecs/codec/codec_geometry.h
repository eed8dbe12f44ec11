/*
 * The geometry behind a BTF, as its session knows it: where cameras and lamps were, and points of
 * the surface, which the lasers measured. Codecs with `geometric` in struct codec use it. Plain
 * data. Any thread.
 */
#pragma once

#include "btf/btf_matrix.h"

/* A point of the surface, in mm in the sample frame. z is the height above the reference plane,
 * and negative below it. */
struct codec_surface_point {
    float x, y, z;
    int view; /* index of the view that measured it; −1 if the BTF lacks this view */
};

struct codec_geometry {
    int n_views, n_lights;
    /* Positions in the sample frame, n_views × 3 and n_lights × 3. The position of a lamp is the
     * mean over the views. Both are NULL if they are not known. */
    float *camera_mm, *lamp_mm;
    gsize n_points; /* 0 if the session has no MDF */
    struct codec_surface_point *points;
};

/* Reads the geometry of the session btf->directory, from the headers of products/btf and from
 * products/mdf.exr. A BTF without a directory has no positions and no points. Fails as
 * near_field_read(), session_check_product() and mdf_table_read() do. */
struct codec_geometry *codec_geometry_read(const struct btf_matrix *btf, GError **error);
/* Gives the unit vector from the centre of a texel to the position positions_mm[index]. If
 * positions_mm is NULL, gives the direction with this index in list. */
void codec_geometry_towards(const struct btf_layout *layout, const float *positions_mm,
                            const struct direction_list *list, int index, int texel, float ret[3]);
void codec_geometry_free(struct codec_geometry *geometry); /* NULL is ignored */

typedef struct codec_geometry CodecGeometry;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CodecGeometry, codec_geometry_free)
