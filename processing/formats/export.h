/*
 * Exports the products of a session for other programs. Files appear complete or not at all. Any
 * thread; a session may be captured and processed meanwhile.
 */
#pragma once

#include "base/work.h"
#include "bonn/bonn.h"
#include "session/session.h"

struct export_bonn_result {
    int n_views, n_lights, width, height;
    double
        error; /* relative error of the factorisation; 0 for BDI, apart from rounding to halves */
};

/* Exports the BTF as a ".btf" of Bonn (bonn.h). n_components: for FMF and DFMF, up to 32, plus
 * the mean. BDI needs the memory of two views, the others that of the whole BTF. Stages "export";
 * "read" and those of lpca.h. */
gboolean export_bonn(const char *session, const char *file, enum bonn_kind kind, int n_components,
                     const struct work *work, struct export_bonn_result *ret, GError **error);
