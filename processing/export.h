/*
 * What a session has become, for other people's programs. Files appear whole or not at all. Any
 * thread; a session may be captured and processed meanwhile.
 */
#pragma once

#include "bonn.h"
#include "pipeline.h"

struct export_progress {
    PipelineFunc func; /* may be NULL; from the calling thread */
    gpointer data;
    GCancellable *cancellable; /* may be NULL */
};

struct export_bonn_result {
    int n_views, n_lights, width, height;
    double error; /* relative, of what is factored; 0 of BDI, but for rounding to halves */
};

/* The BTF as a ".btf" of Bonn (bonn.h). n_components: of FMF and DFMF, up to 32; their mean is one
 * more. BDI takes the memory of two views, the others that of the whole BTF. Stages "export";
 * "read" and those of lpca.h. */
gboolean export_bonn(const char *session, const char *file, enum bonn_kind kind, int n_components,
                     const struct export_progress *progress, struct export_bonn_result *ret,
                     GError **error);
