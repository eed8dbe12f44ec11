/* What is known about one view from the laser sweeps taken so far. For a sample of its texels, the
 * object stores which sweeps saw something there, and at which distance. The distances are computed
 * as for the MDF (mdf/mdf.h), but for a few texels and from single pixels. This is fast enough to
 * be done for every sweep while a session is captured.
 *
 * A texel is known if at least two sweeps agree on its distance, and if at least half of the sweeps
 * that saw something there agree. Light reflected by the surroundings does not agree. The distance
 * is taken at the pixel next to the texel's centre that sees the laser, so that all sweeps look
 * along the same ray. The sheets of light are those of the calibration. The corrections of
 * laser_lines.h are not needed, because they are smaller than half a texel, which is the tolerance
 * of distances.
 *
 * coverage_view_add() may be called in any thread for different sweeps of one view. All other
 * functions may only be called when no coverage_view_add() is running. */
#pragma once

#include "coverage_model.h"
#include "geometry/rig.h"
#include "session/inputs.h"
#include "session/session.h"

#define COVERAGE_MAX_TEXELS 4096 /* maximum number of texels that are examined */

typedef struct CoverageView CoverageView;

/* Creates a view. rig is copied. */
CoverageView *coverage_view_new(const struct rig *rig, int camera, double turntable_deg,
                                const struct session_grid *grid);
void coverage_view_free(CoverageView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CoverageView, coverage_view_free)

/* Adds the sweep of a shot, as the view's camera saw it. input is the file of the camera's frame.
 * The sweep gets the number sweep, which must be less than COVERAGE_MAX_SWEEPS; it replaces a sweep
 * of the same number. Errors are those of input_read(). */
gboolean coverage_view_add(CoverageView *view, int sweep, const struct session_shot *shot,
                           const struct input *input, GError **error);

struct coverage_sums {
    int texels; /* number of texels that were examined and are in the picture */
    int known;  /* texels whose distance is known */
};
/* Counts the examined texels of the picture, and those of them whose distance is known from all
 * added sweeps together.
 * coverage_view_expects() examines the same texels. */
struct coverage_sums coverage_view_sum_up(CoverageView *view);

/* Returns the share of the examined texels that are not known yet and that the sweep is expected to
 * make known. A texel that no sweep has seen needs two sweeps, and counts half.
 * coverage_view_sum_up() must have been called after the last sweep was added. model is the model
 * of the view's camera; its sweeps have the same numbers as those of the view. */
double coverage_view_expects(const CoverageView *view, const CoverageModel *model, int sweep);
