/*
 * Exports a material in the formats of other programs: its mean BRDF as RGL's .bsdf or MERL's
 * .binary, or one of its views as a PTM or for Relight. Files appear complete or not at all. Any
 * thread. The session may be captured and processed during an export.
 */
#pragma once

#include "abrdf.h"
#include "formats/brdf/brdf.h"

struct export_brdf_options {
    enum brdf_kind kind; /* BRDF_RGL or BRDF_MERL */
    /* the texels over which the mean is taken; zeros mean all texels */
    struct import_region region;
    /* for BRDF_RGL: whether to write the mean over rotations about the normal */
    gboolean isotropic;
    gboolean rgb_only; /* for BRDF_RGL: whether to leave out spectra */
};

struct export_brdf_result {
    int n_views, n_lights, width, height; /* width, height: texels of the region */
    gint64 holes;
    /* as in struct abrdf_info */
    int filled;
    double error, lowest_deg;
    double spread; /* spread of struct merl_result for BRDF_MERL; otherwise −1 */
};

/* Writes the mean BRDF of a material to `file`. material is a session, or a file of “mesorig
 * compress”. The progress stages are "read" and "export". */
gboolean export_brdf(const char *material, const char *file,
                     const struct export_brdf_options *options, const struct work *work,
                     struct export_brdf_result *ret, GError **error);

enum export_rti_kind { EXPORT_PTM, EXPORT_RELIGHT };

struct export_rti_options {
    enum export_rti_kind kind;
    /* TRUE: each colour has six terms (RGB). FALSE: the brightness has six terms, and multiplies a
     * colour (LRGB). */
    gboolean rgb;
    int view; /* index; −1 means the view nearest to the normal */
    /* whether to replace the files of an existing folder; if FALSE, an existing folder is an
     * error */
    gboolean replace;
};

struct export_rti_result {
    int width, height, n_lights;
    int view;
    double theta_deg; /* angle of the view from the normal */
    double error;     /* RMS difference in sRGB, see struct rti_fit_result */
    /* clipped: number of values that were clipped
     * holes: number of holes */
    gint64 clipped, holes;
};

/* Exports one view of a session to output: a .ptm file (EXPORT_PTM), or a folder with info.json and
 * planes (EXPORT_RELIGHT). Needs the memory of one view. Fails if there is no such view, or if its
 * lights do not determine six terms. The progress stage is "read". */
gboolean export_rti(const char *session, const char *output,
                    const struct export_rti_options *options, const struct work *work,
                    struct export_rti_result *ret, GError **error);
