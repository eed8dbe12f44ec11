/*
 * Normals, albedo and heights of a session from its pictures at the lights where they were taken,
 * by photometric stereo (photometric.h): of the view nearest to the normal. It needs no model.
 * Any thread.
 */
#pragma once

#include "photometric.h"

struct light_normals_result {
    int width, height, n_lights;
    int view;                       /* of the session's views */
    int texels, holes;              /* holes: texels without a normal, */
    int causes[PHOTOMETRIC_CAUSES]; /* by cause */
    double sigma_deg[2];            /* median and 95th percentile of the normals' errors */
    double used;                    /* median number of lights that agree */
};

/* Whether a path is a session with a BTF and without an MDF. */
gboolean light_normals_applies(const char *path);

/* Writes an EXR: parts "normals" with "X", "Y", "Z", all 0 where there is none; "sigma" with "Y",
 * the error of each normal in degrees (RMS); "albedo" with R, G, B; and "used" with "N", the number
 * of lights that agree, or minus the cause of a hole (enum photometric_cause). With heights instead
 * a part "height" with "Z" in mm, with mean 0, and "N", 1, or 0 for a hole. Attributes:
 * mesorig.kind, mesorig.model ("lights"), texel_mm, reference_mm, holes. DATA_ERROR if no texel has
 * a normal. */
gboolean light_normals(const char *session, const char *file, gboolean heights,
                       const struct work *work, struct light_normals_result *ret, GError **error);
