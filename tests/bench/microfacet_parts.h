/* The parts of bench_microfacet, a file each. What they print is a part of one JSON object, or
 * lines. */
#pragma once

#include <glib.h>

/* Times of Kang & Cho 2011, Table I: shading at the vertices, an anisotropic surface without a
 * normal map, with one (plain normal mapping), and with microfacets that turn with the normal by
 * the approximate rotation, by the exact one as microfacet.glsl has it, and by the exact one as a
 * matrix (eq. 4 … 6). Then what a rotation alone takes (fig. 7). In a GL context. */
gboolean microfacet_times(int frames, GError **error);

/* Distributions of microfacets over the half vector, seen from above, for normals that tilt towards
 * an azimuth of 50°, by each rotation and without (figs 2, 3, 5). The cross is the normal. Ends the
 * program if the PNG cannot be written. */
void microfacet_lobes(const char *path);

/* Woven fabric as in fig. 10, side by side: anisotropy that alternates between warp and weft, the
 * same with the normals of yarns, and with microfacets that turn with them. Makes its own GL
 * context. */
gboolean microfacet_fabric(const char *path, GError **error);
