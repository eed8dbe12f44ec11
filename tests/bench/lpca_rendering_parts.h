/* The parts of bench_lpca_rendering, a file each. Each adds objects to the list that is open. They
 * need a GL context. */
#pragma once

#include "codecs/lpca/lpca.h"

/* Explains the gain of Schneider 2004 §6. Counts the texture fetches of a pixel and measures the
 * time while a torus is drawn by pairs, from the 3D texture and from the grid. Also measures the
 * time of the 3D texture if the filter of the card reads one sample instead of eight, and the time
 * without the fetches of eigen-BRDFs and weights, which are replaced by arithmetic with the same
 * addresses. */
gboolean lpca_rendering_fetches(struct lpca *lpca, int n_grid, int frames, GError **error);

/* What mip levels (Schneider 2004 §8) cost and gain, from a file of “mesorig compress --mips”: the
 * time of a torus with and without them, and a plane drawn with a sample a pixel while the camera
 * moves away, against the mean of 25 samples a pixel by the same method without levels. */
gboolean lpca_rendering_mips(const char *path, int n_grid, int frames, GError **error);
