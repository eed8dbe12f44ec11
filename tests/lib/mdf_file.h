/* MDF files in the form in which processing writes them. */
#pragma once

#include "exr/exr.h"

/* Adds a view. planes[0] of the part has its distances, which are 0. */
struct exr_part *mdf_file_add_view(struct exr_file *file, int view, int width, int height,
                                   double theta_deg, double phi_deg, double texel_mm);
