/* Finds normals, albedo and heights of a session from its pictures under the measured lights, by
 * photometric stereo (photometric.h). Uses the view nearest to the normal. The session needs no PTM
 * or other model. Any thread. */
#pragma once

#include "photometric.h"

struct light_normals_result {
    int width, height, n_lights;
    int view; /* position of the view among the views that have a file,
                 from 0 */
    /* texels: number of all texels
     * holes: number of texels without a normal */
    int texels, holes;
    int causes[PHOTOMETRIC_CAUSES]; /* number of texels by cause (enum photometric_cause) */
    double sigma_deg[2]; /* median and 95th percentile of the standard errors of the normals */
    double used; /* median, over the texels with a normal, of the number of lights that agree */
};

/* Returns whether a path is a session with a BTF and without an MDF. */
gboolean light_normals_applies(const char *path);

/* Writes an EXR with these parts:
 *   "normals"  "X", "Y", "Z"; all 0 for a texel without a normal
 *   "sigma"    "Y": error of each normal in degrees (RMS)
 *   "albedo"   "R", "G", "B"
 *   "used"     "N": number of lights that agree; for a hole, minus its cause (enum
 *              photometric_cause)
 * If heights is TRUE, the file has only this part instead:
 *   "height"   "Z": height in mm, with mean 0; "N": 1, or 0 for a hole
 *
 * The attributes are mesorig.kind, mesorig.model ("lights"), texel_mm, reference_mm and holes. The
 * progress stage is "normals". The error is in DATA_ERROR if no texel has a normal, if the session
 * has no BTF or fewer than three lights, or if a picture lacks a colour or differs from the session
 * in size. */
gboolean light_normals(const char *session, const char *file, gboolean heights,
                       const struct work *work, struct light_normals_result *ret, GError **error);
