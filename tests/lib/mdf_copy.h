/* A copy of an MDF that a test or bench changes. */
#pragma once

#include "mdf/mdf_table.h"

static inline struct mdf_table *mdf_copy(const struct mdf_table *t) {
    const gsize n = (gsize)t->width * t->height * t->n_views;
    struct mdf_table *copy = g_memdup2(t, sizeof *t);
    copy->theta_deg = g_memdup2(t->theta_deg, sizeof(float) * t->n_views);
    copy->phi_deg = g_memdup2(t->phi_deg, sizeof(float) * t->n_views);
    copy->depth_mm = g_memdup2(t->depth_mm, sizeof(float) * n);
    copy->seen = t->seen != NULL ? g_memdup2(t->seen, n) : NULL;
    return copy;
}
