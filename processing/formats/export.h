/*
 * What a session has become, for other people's programs. Files appear whole or not at all. Any
 * thread; a session may be captured and processed meanwhile.
 */
#pragma once

#include "base/work.h"
#include "bonn.h"
#include "session/session.h"

struct export_bonn_result {
    int n_views, n_lights, width, height;
    double error; /* relative, of what is factored; 0 of BDI, but for rounding to halves */
};

/* The BTF as a ".btf" of Bonn (bonn.h). n_components: of FMF and DFMF, up to 32; their mean is one
 * more. BDI takes the memory of two views, the others that of the whole BTF. Stages "export";
 * "read" and those of lpca.h. */
gboolean export_bonn(const char *session, const char *file, enum bonn_kind kind, int n_components,
                     const struct work *work, struct export_bonn_result *ret, GError **error);
