/*
 * Makes the textures from which a WebGL page draws a material. They have the same numbers as the
 * textures of mesorig-view, so that the page shows the same picture as the viewer. These are the
 * textures of the methods lpca-revised (lpca_volumes.h, renderer/drawing/methods/lpca_revised.h)
 * and neural (neural_drawing.h), and of the shell of an MDF (mdf_shell.h). Any thread.
 *
 * A local PCA has these sections. L is the number of mip levels. K, c and n are in the header of
 * the file: "clusters" (of all levels), "components" and "grid".
 *
 *   clusters      for each level, texels × uint16: cluster, counted through all levels
 *   weights       for each level, texels × c halves
 *   scales        K × c floats, by which the weights of a cluster are multiplied
 *   means         K blocks of (n² + 1) × n² × 3 halves
 *   brdfs         K × c blocks of (n² + 1) × n² × 3 signed bytes
 *
 * Neural planes have other sections instead of these five. The header has "neural": "channels";
 * "plane", the number of rows of the planes; "sky", columns and rows of the sky; "heights", minimum
 * and step of heights in texels.
 *   surface       channels / 4 layers of texels × 4 bytes
 *   heights       2 height × 2 width bytes
 *   planes        floats of neural_shader_planes()
 *   sky           halves: neural_shader_sky()
 *   network       text of neural_shader_network()
 *
 * A local PCA and neural planes have:
 *   shell         the values of mdf_shell.h: depth × height × width bytes; only if there is an MDF.
 *                 The header has the other members of mdf_shell.h in "shell".
 *
 * The following sections have the measured views of the MDF. They are missing if there is no MDF,
 * or if its views cannot be triangulated. The header has width, height and the number of views in
 * "along".
 *   depths        views × height × width bytes: depths below the reference plane, as shares of the
 *                 shell's depth_mm; 255 is depth_mm
 *   directions    views × 3 floats: unit vectors towards the views
 *   triangles     n × 3 × uint16: corners of the triangles of the views (directions_triangles())
 */
#pragma once

#include "base/work.h"
#include "codecs/lpca/lpca.h"
#include "codecs/neural/neural.h"
#include "mdf/mdf_shell.h"
#include "mdf/mdf_table.h"
#include "webgl_file.h"

#define WEBGL_PACK_GRID_MIN 4
#define WEBGL_PACK_GRID_MAX 16

/* The parts of a material that are packed; all are borrowed. */
struct webgl_pack {
    const char *name;
    /* LPCA_RGB; a level from a packed file has been regrouped (lpca_regroup()) */
    struct lpca *const *levels;
    int n_levels;
    const struct mdf_shell *shell; /* NULL if there is no MDF */
    const struct mdf_table *views; /* measured views of the MDF; NULL if there is no MDF */
    /* Neural planes, or NULL. If there are neural planes, they are packed instead of the levels,
     * which are not read. */
    const struct neural *neural;
};

/* Returns the number of bytes of all sections before compression, with a grid of n_grid. */
gint64 webgl_pack_bytes(const struct webgl_pack *pack, int n_grid);

/* Packs with eigen-BRDFs on a grid of n_grid. A local PCA that is already on a grid keeps its grid.
 * The progress stage is "pack". The error is DATA_ERROR_INVALID if values are not finite, if a
 * texel has a cluster that does not exist, or if all levels together have more than 65535
 * clusters. */
GBytes *webgl_pack(const struct webgl_pack *pack, int n_grid, const struct work *work,
                   GError **error);
