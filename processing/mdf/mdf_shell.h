/*
 * A shell: the opacity of the space between the reference plane and the deepest structure, as a
 * volume. A shell is made from the MDF, and is therefore measured. A shell can represent overhangs
 * and holes, unlike a height field. Renderers march rays through it in directions that no camera
 * had. A shell is a generalised displacement map (Wang, X. et al. 2004, “Generalized Displacement
 * Maps”), for which Wang, J. et al. 2005 knew no way of capture.
 *
 * A ray that advances by ds meets the structure on this path with the probability σ ds, where
 *
 *   σ(x) = most_per_mm · g(x)⁴,   g(x) = Σ_k g_k φ_k(x)
 *
 * g_k is value / 255 at the centre of voxel k, and φ_k interpolates linearly between the eight
 * centres around x. A ray is opaque after ∫ σ ds = ln 2, because half of such rays have met the
 * structure by then. A surface that is larger than a voxel gives a sharp rise of σ. Structure that
 * is thinner than a voxel gives the density with which it stops rays.
 *
 * Each texel of each view of the MDF is a ray that is free over the length of its distance and
 * stops there. The g_k maximise the likelihood of all these rays:
 *
 *   Σ_rays ( ln σ(stop) − ∫ σ ds )
 */
#pragma once

#include "mdf_table.h"

struct mdf_shell {
    int width, height, depth;             /* number of voxels along x, y and the depth */
    double width_mm, height_mm, depth_mm; /* size; the shell repeats along x and y */
    double top_mm;                        /* depth above which every value is 0 */
    double most_per_mm;                   /* σ at the value 255 */
    guint8 *values; /* depth × height × width; top layer and top row first */
};

/* Makes a shell from the measured views of a table. Space that no ray has reached is opaque. With
 * four views or more, the shell has at most as many bytes as the depths of these views at one byte
 * each. Takes about a second for 60 views of 64² texels. Any thread. */
struct mdf_shell *mdf_shell_new(const struct mdf_table *table);

typedef struct mdf_shell MdfShell;
void mdf_shell_free(struct mdf_shell *shell); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfShell, mdf_shell_free)
