/*
 * What the laser sweeps taken so far know of one view: for a sample of its texels, which sweeps saw
 * something there, and whether they agree. This is the MDF (mdf/mdf.h) of few texels from single
 * pixels, quick enough to be made of every sweep while a session is captured.
 *
 * A texel is known if two sweeps agree on its distance, and those that agree are at least half of
 * those that saw something there: light reflected by the surroundings does not agree. The distance
 * is looked up at the pixel next to the texel's centre that sees the laser, so that all sweeps look
 * along one ray. Sheets of light are used as calibrated; the corrections of laser_lines.h are
 * smaller than half a texel, by which distances may differ.
 *
 * coverage_view_add() may be called in any thread for different sweeps of one view; everything else
 * when none of them runs.
 */
#pragma once

#include "coverage_model.h"
#include "geometry/rig.h"
#include "session/inputs.h"
#include "session/session.h"

#define COVERAGE_MOST_TEXELS 4096 /* that are looked at */

typedef struct CoverageView CoverageView;

/* rig is copied. */
CoverageView *coverage_view_new(const struct rig *rig, int camera, double turntable_deg,
                                const struct session_grid *grid);
void coverage_view_free(CoverageView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CoverageView, coverage_view_free)

/* Adds the view's part of a shot's file under the number sweep, below COVERAGE_MAX_SWEEPS. Replaces
 * what was added under that number before. Errors as of input_read(). */
gboolean coverage_view_add(CoverageView *view, int sweep, const struct session_shot *shot,
                           const struct input *input, GError **error);
gboolean coverage_view_has(const CoverageView *view, int sweep);

struct coverage_sums {
    int texels; /* that were looked at and lie in the picture */
    int known;
};
/* Counts the texels, and those that all added sweeps together make known. coverage_view_expects()
 * counts the same texels. */
struct coverage_sums coverage_view_sum_up(CoverageView *view);

/* The share of the view's texels that are not known and that a sweep is expected to make known. A
 * texel that no sweep has seen needs two, and counts half. model: that of the view's camera, with
 * the same numbering of sweeps. */
double coverage_view_expects(const CoverageView *view, const CoverageModel *model, int sweep);
