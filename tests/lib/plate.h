/* The MDF of a plate that stands over a floor like a table, so that rays go under it. Its distances
 * have closed forms. Lengths are in mm. */
#pragma once

#include "mdf/mdf_table.h"

#define PLATE_RINGS  5
#define PLATE_TEXELS 32 /* along x */
#define PLATE_ROWS   8
#define PLATE_TILE   25.0 /* size along x */
#define PLATE_HEIGHT (PLATE_TILE * PLATE_ROWS / PLATE_TEXELS)
#define PLATE_TOP    1.0 /* of the plate */
#define PLATE_BOTTOM 2.0
#define PLATE_FLOOR  4.0
#define PLATE_LEFT   8.0 /* edges of the plate along x; it has no end along y */
#define PLATE_RIGHT  17.0

/* Returns the depth at which a ray from (x, y) on the reference plane stops. x grows by dx for each
 * mm of depth. */
double plate_depth(double x, double dx);
/* Returns dx of a ray. The angles are those of the view, from which the ray comes. */
double plate_slant(double theta_deg, double phi_deg);
/* Has 1 to 5 rings of twelve views, 15° apart. */
struct mdf_table *plate_table(int rings);
/* Writes the table in the form in which processing writes it. */
void plate_write(const char *path, int rings);
