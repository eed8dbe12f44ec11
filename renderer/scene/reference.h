/*
 * Pictures from the uncompressed BTF (products/btf of a session), as the reference for compressed
 * materials; or from a compressed one by libmesorig-material, as the reference for the graphics
 * card's picture of it. Directions are interpolated the same way as on the graphics card, texels
 * bilinearly without mip levels, all on the CPU.
 *
 * Light of all lamps of the settings is added up, each lamp as in the viewer's geometry.
 *
 * Views are read one after the other, once for each lamp. Memory: one view, and some 100 bytes for
 * each sample of the picture that shows the mesh; a picture has at most REFERENCE_MAX_SAMPLES
 * samples.
 */
#pragma once

#include "viewer.h"

#define REFERENCE_ERROR reference_error_quark()
GQuark reference_error_quark(void);
enum reference_error {
    REFERENCE_ERROR_NONE,   /* there is no BTF */
    REFERENCE_ERROR_FORMAT, /* its files do not fit together */
};

#define REFERENCE_MAX_SAMPLES (8 << 20)

typedef struct Reference Reference;

/* btf: a folder of files view_….exr as pipeline.h says. Reads their headers. */
Reference *reference_open(const char *btf, GError **error);
/* path: a file that “mesorig compress” or “mesorig process” wrote. Such a reference renders
 * pictures, but cannot read views. */
Reference *reference_open_material(const char *path, GError **error);
/* From now on pictures of the whole BTF mix views along the surface of its MDF
 * (reprojection/reprojection.h). The sample must repeat, without an index map. mdf:
 * products/mdf.exr. Texels are always interpolated. Memory: some 150 bytes more per sample, and the
 * MDF. */
gboolean reference_move_along_surface(Reference *reference, const char *mdf, GError **error);
void reference_free(Reference *reference); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Reference, reference_free)

struct reference_info {
    int width, height, n_views, n_lights;
    const float *view_theta_deg, *view_phi_deg;   /* n_views; owned by the reference, as the next */
    const float *light_theta_deg, *light_phi_deg; /* n_lights */
};
struct reference_info reference_info(const Reference *reference);

/* n_lights × height × width × 3 (R, G, B). */
gboolean reference_read_view(const Reference *reference, int view, float *ret, GError **error);

/* As viewer_render() and viewer_render_linear(); the view gives mesh, background and tone.
 * ret_error, if not NULL: ‖view − reference‖ / ‖reference‖ over the samples that show the mesh. */
guint8 *reference_render(Reference *reference, Viewer *viewer,
                         const struct viewer_settings *settings, int width, int height,
                         double *ret_error, GError **error);
float *reference_render_linear(Reference *reference, Viewer *viewer,
                               const struct viewer_settings *settings, int width, int height,
                               double *ret_error, GError **error);

/* The same for a scene: references[k], of n, belongs to the viewer's material number k; NULL: the
 * viewer's picture of this material stays, and the error leaves it out. */
guint8 *reference_render_scene(Reference *const *references, int n, Viewer *viewer,
                               const struct viewer_settings *settings, int width, int height,
                               double *ret_error, GError **error);
float *reference_render_scene_linear(Reference *const *references, int n, Viewer *viewer,
                                     const struct viewer_settings *settings, int width, int height,
                                     double *ret_error, GError **error);
