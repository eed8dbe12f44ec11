#include "mdf_tabulated.h"

int mdf_factors_layers(int n_terms) {
    return (n_terms + MDF_TABULATED_MAPS - 1) / MDF_TABULATED_MAPS;
}

/* Returns W_factor(v) of mdf_factors.h in a direction, interpolated between views. at has the views
 * around the direction and their weights. */
static double mdf_tabulated_at(const struct mdf_factors *f, const Directions *views, int factor,
                               const struct direction_weights *at) {
    double sum = 0.0;
    for (int k = 0; k < 4; k++) {
        int n;
        const int *members = directions_pole(views, &n), one = at->index[k];
        gboolean pole = one >= f->n_views;
        for (int m = 0; m < (pole ? n : 1); m++)
            sum += at->weight[k] / (pole ? n : 1) *
                   f->weights[(gsize)(pole ? members[m] : one) * (f->n_terms + 1) + factor];
    }
    return sum;
}

float *mdf_factors_tabulate(const struct mdf_factors *f, const Directions *views) {
    const int size = MDF_TABULATED_SIZE, layers = mdf_factors_layers(f->n_terms);
    float *table = g_new0(float, (gsize)(layers + 1) * MDF_TABULATED_PAGE);
    for (int cell = 0; cell < size * size; cell++) {
        const double a = -1.0 + 2.0 * (cell % size) / (size - 1);
        const int row = cell / size;
        const double b = -1.0 + 2.0 * row / (size - 1);
        float *to = table + MDF_TABULATED_MAPS * (gsize)cell;
        struct direction_weights at;
        directions_weights(views, directions_from_square(a, b), &at);
        for (int term = 0; term < f->n_terms; term++)
            to[term / MDF_TABULATED_MAPS * MDF_TABULATED_PAGE + term % MDF_TABULATED_MAPS] =
                255.0 * mdf_tabulated_at(f, views, term + 1, &at);
        to[layers * MDF_TABULATED_PAGE] = mdf_tabulated_at(f, views, 0, &at);
    }
    return table;
}
