/* A grey diffuser on a shape, and what simulated samples truly are as an MDF. */
#pragma once

#include "gpu_fixture.h"
#include "silhouettes.h"
#include "world_fixture.h"

Viewer *silhouettes_view(const struct mesh *mesh, const struct mdf_table *mdf);

/* How many of n values of two pictures differ by more than a tolerance. */
int silhouettes_differ(const float *a, const float *b, int n, float tolerance);

#define N_THETA 5
#define N_PHI   12
#define TEXELS  48

/* The MDF that the world's own truth says, through the file that processing would write. */
char *silhouettes_write_truth(World *world, const struct truth_grid *grid);
/* Of n_theta rings of n_phi views, which the world's cameras from first_camera on see. */
char *silhouettes_write_truth_rings(World *world, const struct truth_grid *grid, int first_camera,
                                    const double *theta_deg, int n_theta, int n_phi);
World *silhouettes_world(const char *kind, double relief_mm);
