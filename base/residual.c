#include "residual.h"

#include <glib.h>
#include <math.h>

char *residual_warning(const struct residual *residual) {
    const double value = residual->value, expected = residual->expected;
    if (!(expected > 0) || value <= RESIDUAL_LIMIT * expected)
        return NULL;
    return g_strdup_printf(
        "%s fits with an error of %.3g%s%s, but noise explains only %.3g%s%s; possible causes: %s",
        residual->of, value, *residual->unit ? " " : "", residual->unit, expected,
        *residual->unit ? " " : "", residual->unit, residual->causes);
}

double residual_excess(const struct residual *residual) {
    const double value = residual->value, expected = residual->expected;
    return expected > 0 && value > expected ? sqrt(value * value - expected * expected) : 0;
}
