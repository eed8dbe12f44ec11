/* The expected benefit of a laser sweep before it is taken. The model knows from which directions a
 * point of a surface was lit, and from which it was not. It says with which probability the point
 * is lit from another direction.
 *
 * The model assumes that a surface point is visible from, and lit from, all directions within a
 * cone about its axis. The rest of the sky is hidden by the point's own surface and by its
 * surroundings. The model is a set of such cones with axes up to 60° from the sample's normal and
 * half-angles of 25° to 85°. The cones are spread evenly over these tilts and half-angles and over
 * all azimuths, so that no kind of relief is preferred. The observations of a point weight the
 * cones (Bayes). There is a small probability that a sweep was misled.
 *
 * A sweep that lights a point settles its distance with the probability s = 0.03 + 0.5 q, which
 * grows with the depth resolution of the pair of camera and laser. Here q, 0 … 1, is the precision
 * with which the sweep measures a distance, relative to the most precise sweep
 * (plan_sweep_model()). Several sweeps settle the distance with the probability 1 − Π (1 − s), so
 * that each further sweep adds less.
 *
 * Pure functions, any thread. */
#pragma once

#include "base/vec.h"

#include <glib.h>

/* maximum number of sweeps at one turntable angle; each is a bit of a guint64 */
#define COVERAGE_MAX_SWEEPS 64

typedef struct CoverageModel CoverageModel;

/* Makes a model for a camera and n laser positions. Directions are unit vectors from the sample
 * outwards, in one frame. quality is q of each sweep, 0 … 1. All arrays are copied. */
CoverageModel *coverage_model_new(struct vec3 camera, const struct vec3 *lasers,
                                  const double *quality, int n);
void coverage_model_free(CoverageModel *model); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(CoverageModel, coverage_model_free)

/* Returns the share of texels, among those that the camera sees, that a sweep is expected to settle
 * in addition to the taken sweeps. `sweep` is the number of this sweep. Bit i of `taken` stands for
 * sweep i. What the taken sweeps saw is not used. Returns 0 if no cone of the model contains the
 * camera. */
double coverage_model_adds(const CoverageModel *model, guint64 taken, int sweep);

/* Returns the probability that a sweep lights a point that the camera sees. `taken` and `lit` are
 * sets of sweeps, with bit i for sweep i. Of the sweeps in `taken`, those in `lit` saw something at
 * this point, and the others saw nothing. */
double coverage_model_lights(const CoverageModel *model, guint64 taken, guint64 lit, int sweep);
