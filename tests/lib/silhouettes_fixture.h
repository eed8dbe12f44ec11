/* A grey diffuser on a shape, and MDFs with the true distances of simulated samples. */
#pragma once

#include "gpu_fixture.h"
#include "silhouettes.h"
#include "world_fixture.h"

Viewer *silhouettes_view(const struct mesh *mesh, const struct mdf_table *mdf);

/* Returns how many of the n values of two pictures differ by more than a tolerance. */
int silhouettes_differ(const float *a, const float *b, int n, float tolerance);

#define N_THETA 5
#define N_PHI   12
#define TEXELS  48

/* Writes an MDF with the true distances of the world, in the form in which processing writes it. */
char *silhouettes_write_truth(World *world, const struct truth_grid *grid);
/* Does the same with n_theta rings of n_phi views. The views are those of the world's cameras from
 * first_camera on. */
char *silhouettes_write_truth_rings(World *world, const struct truth_grid *grid, int first_camera,
                                    const double *theta_deg, int n_theta, int n_phi);
World *silhouettes_world(const char *kind, double relief_mm);
