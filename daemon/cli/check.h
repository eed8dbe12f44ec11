/* The plot of “mesorig check”. */
#pragma once

#include "btf/energy.h"
#include "plot.h"

/* E_r of all views and E_i of all lights, of one texel and of the mean, as in Meseth et al. 2003
 * Fig. 3. */
gboolean plot_energy(const char *path, const struct btf_matrix *btf, const struct energy *energy,
                     GError **error);
