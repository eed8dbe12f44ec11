/*
 * Makes the products of a session from its frames. Can follow a capture that is still running.
 *
 *   products/btf/view_0000.exr   A file for each view, with a part "light_0000" for each light.
 *                                Channels:
 *                                  B G R (half): the reflectance (see below) on the texel grid
 *                                  "mark": flags; exists if any texel has a flag. Attributes have
 *                                  the number of texels of each flag; see btf.h.
 *                                  "sigma": exists, with attributes, if the noise of the camera is
 *                                  calibrated; see btf_sigma.h.
 *                                Attributes of every part:
 *                                  view.theta_deg view.phi_deg light.theta_deg light.phi_deg
 *                                  (double): nominal directions
 *                                  view.centre_mm light.position_mm (v3d): calibrated positions of
 *                                  camera and lamp, sample frame. The exact directions of a texel
 *                                  point from the texel to these positions.
 *                                  light.aim (v3d, sample frame), light.exponent (double): the lamp
 *                                  shines in the direction of its aim, and with cos^exponent of
 *                                  the angle from it. Missing means an exponent of 0.
 *                                  mesorig.saturated (int): number of pixels of the frame that are
 *                                  saturated in the shortest exposure
 *
 *   products/mdf.exr             A part "view_0000" for each view, with float channels:
 *                                  "D" distance, mm; −1: unknown
 *                                  "M" distance measured by this view; −1: not measured
 *                                  "N" number of laser positions over which M is the mean
 *                                  "O" another distance that this view may have measured
 *                                  (mdf_view_other()); −1: none
 *                                  "P" source of D: 0 none, 1 M, 2 O, 3 predicted from other views,
 *                                  not measured (mdf_views_settle())
 *                                  "S" standard error of M, mm (mdf_view_merge()); −1: no M
 *                                Attributes: view.theta_deg view.phi_deg, view.centre_mm (v3d: the
 *                                camera, sample frame), reference_mm, texel_mm, and lines.*: the
 *                                agreement of the laser's line around the sample with the
 *                                calibration (mdf_lines.h)
 *
 *   products/eigenmaps.exr       See eigenmaps.h.
 *
 * In the sample frame, the centre of texel (i, j) is at x = −w/2 + (i+½)·w/n, y = +h/2 − (j+½)·h/m,
 * in the reference plane. The grid has n × m texels and the size w × h. Row 0 is at +y.
 *
 * A BTF value is the reflected radiance L, divided by the radiance of a white diffuser in the
 * reference plane that is lit along its normal by the same lamp at the same distance: L·π / E_⊥. It
 * contains n·l. A view shows the surface as seen through the reference plane: the value at p
 * belongs to the ray from the camera through p. MDF values are lengths along that ray from p to the
 * surface. BTF values and MDF values belong to the true (near-field) ray of each texel.
 */
#pragma once

#include "base/work.h"
#include "session/session.h"

struct pipeline_options {
    gboolean follow; /* wait for missing inputs until the capture has ended */
    int n_eigenmaps; /* number of eigen-maps; 4 in Wang et al. 2005 §5 */
    /* calibration_to_text() of another calibration of the same rig, or NULL for the session's own.
     * If this calibration does not know a lamp, the output that was measured on the turntable's
     * fiducials during the capture is not used for the lamp. calibration_path is the origin of the
     * calibration, or "nominal"; it is recorded with the products (session/made_with.h). */
    const char *calibration, *calibration_path;
    /* Finds laser lines in each frame, as the paper does (frames/laser_pictures.h), for comparison.
     * The session must have kept its laser frames. */
    gboolean lines_in_pictures;
    /* Merges the laser positions by the plain mean of the paper (mdf_view_set_plain()), for
     * comparison. */
    gboolean plain_merge;
    /* receives the sentences of causes_find() (char *); NULL if they are not needed */
    GPtrArray *causes;
    struct work work;
};

struct pipeline_result {
    /* numbers of views and lights in the BTF, without views that are not complete */
    int n_views, n_lights;
    /* number of pictures that were not taken and are predicted from others (btf.h) */
    int n_predicted;
    /* number of predicted pictures that the capture left out because they can be predicted */
    int n_left_out;
    /* number of captured pictures from which these are predicted (prediction_product.h) */
    int n_used;
    /* expected error of the predicted pictures, relative to the whole BTF; NAN if no picture is
     * predicted */
    double prediction_error;
    int n_mdf_views;
    /* number of products that were damaged or missing, and are made again */
    int n_damaged;
    /* relative RMS error ‖A − Â‖_F / ‖A‖_F, where A is the BTF, and Â the BTF that the eigen-maps
     * in the file give */
    double eigenmaps_error;
    /* share of the texels of all views that were measured in their own view */
    double mdf_coverage;
    double mdf_predicted; /* share of the texels that were predicted from other views */
    /* Laser lines on the flat face around the sample (laser_lines.h).
     *   line_sweeps          number of sweeps
     *   lines_found          number of sweeps that show a line
     *   lines_disagree       number of sweeps whose line disagrees with the calibration
     *   line_worst_position  laser position of lines_worst_deg; −1 if no line was seen
     *   lines_rms_deg        RMS angle error of the sheets, over the sweeps that show a line
     *   lines_worst_deg      worst_deg of struct mdf_lines (mdf_lines.h) */
    int line_sweeps, lines_found, lines_disagree, line_worst_position;
    double lines_rms_deg, lines_worst_deg;
    double line_width, line_scatter; /* see mdf_lines.h; 0 if unknown */
};

/* Makes the products of a session, in the calling thread and a pool of threads. The bytes of the
 * products depend only on the frames, not on threads or order. Only one process at a time makes the
 * products of a session; the error is otherwise G_IO_ERROR_BUSY.
 *
 * Products that are up to date are not made again. Every part has the hash of the inputs from which
 * it was computed in mesorig.inputs (string). A product is up to date if this hash is that of the
 * present inputs, and if its file has the checksum that is stored in the session.
 *
 * Views of the BTF and of the MDF are made alternately. The progress stages are
 * - "verify", which compares existing products with their checksums,
 * - "btf" until all views of the BTF are made,
 * - "mdf",
 * - "read" and "prediction", if pictures were left out and are predicted again
 *   (prediction_product.h),
 * - "eigenmaps".
 * The time left of the stages after "verify" is that for all of them together.
 *
 * With follow, the function ends when the session's value "state" is "done" or "aborted", or when
 * all products are made. The function sets the session's values of prediction_product.h,
 * "eigenmaps_error", "mdf_coverage", "processing_s" and "processing_peak_memory_mib". */
gboolean pipeline_run(const char *session_path, const struct pipeline_options *options,
                      struct pipeline_result *ret, GError **error);
