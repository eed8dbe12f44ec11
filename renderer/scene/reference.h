/*
 * Reference pictures. A picture from the uncompressed BTF (products/btf of a session) is the
 * reference for compressed materials. A picture from a compressed material by libmesorig-material
 * is the reference for the picture of the graphics card. Directions are interpolated as on the
 * graphics card, and texels bilinearly without mip levels. All work is done on the CPU.
 *
 * The light of all lamps of the settings is added up. Each lamp has the geometry of the viewer.
 *
 * Views are read one after the other, once for each lamp. Rendering needs the memory of one view,
 * and about 100 bytes for each sample of the picture that shows the mesh. A picture has at most
 * REFERENCE_MAX_SAMPLES samples.
 */
#pragma once

#include "viewer.h"

#define REFERENCE_ERROR reference_error_quark()
GQuark reference_error_quark(void);
enum reference_error {
    REFERENCE_ERROR_NONE, /* there is no BTF */
    /* a file is damaged or too large for the memory, or BTF, MDF, index map and options do not fit
     * together */
    REFERENCE_ERROR_FORMAT,
};

#define REFERENCE_MAX_SAMPLES (8 << 20)

typedef struct Reference Reference;

/* Opens a BTF. btf is a folder of files view_….exr as described in pipeline.h. Only the headers of
 * the files are read. */
Reference *reference_open(const char *btf, GError **error);
/* Opens a compressed material. path is a file that “mesorig compress” or “mesorig process” wrote.
 * Such a reference can only render pictures, because reference_info() and reference_read_view()
 * need a BTF. */
Reference *reference_open_material(const char *path, GError **error);
/* From now on, pictures from the BTF mix views along the surface that an MDF describes
 * (mdf/reprojection.h). mdf is the path of products/mdf.exr of the session. The reference must come
 * from reference_open(). The sample must repeat, without an index map. Texels are always
 * interpolated. In addition to the memory named above, rendering takes the memory of the MDF and
 * about 150 bytes for each sample of the picture that shows the mesh. */
gboolean reference_move_along_surface(Reference *reference, const char *mdf, GError **error);
void reference_free(Reference *reference); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Reference, reference_free)

struct reference_info {
    int width, height, n_views, n_lights;
    const float *view_theta_deg, *view_phi_deg;   /* n_views elements, owned by the reference */
    const float *light_theta_deg, *light_phi_deg; /* n_lights elements, owned by the reference */
};
struct reference_info reference_info(const Reference *reference);

/* Reads a view into ret: n_lights × height × width × 3 (R, G, B). Values that are not finite become
 * 0. */
gboolean reference_read_view(const Reference *reference, int view, float *ret, GError **error);

/* reference_render_scene() works like viewer_draw(), and returns width × height × 3 bytes, sRGB,
 * top row first. reference_render_scene_linear() works like viewer_render_linear(). Both return
 * NULL on error. The viewer gives mesh, background and tone.
 *
 * references has n elements, and references[k] belongs to material k of the viewer. If
 * references[k] is NULL, the picture shows material k as the viewer draws it.
 *
 * *ret_error is ‖p − r‖ / ‖r‖, with the viewer's picture p and the reference r. The norms are over
 * all samples of the mesh that show a material with a reference. The error is 0 if r is black.
 * ret_error may be NULL. */
guint8 *reference_render_scene(Reference *const *references, int n, Viewer *viewer,
                               const struct viewer_settings *settings, int width, int height,
                               double *ret_error, GError **error);
float *reference_render_scene_linear(Reference *const *references, int n, Viewer *viewer,
                                     const struct viewer_settings *settings, int width, int height,
                                     double *ret_error, GError **error);
