/* The parts of bench_microfacet, a file each. What they print is a part of one JSON object, or
 * lines. */
#pragma once

#include <glib.h>

/* Times of Kang & Cho 2011, Table I: shading at the vertices, an anisotropic surface without a
 * normal map, with one (plain normal mapping), and with microfacets that turn with the normal by
 * the approximate rotation, by the exact one as microfacet.glsl has it, and by the exact one as a
 * matrix (eq. 4 … 6). Then what a rotation alone takes (fig. 7). In a GL context. */
gboolean microfacet_times(int frames, gboolean json, GError **error);
