/*
 * Exports the products of a session for other programs. Files appear complete or not at all. Any
 * thread. The session may be captured and processed during an export.
 */
#pragma once

#include "base/work.h"
#include "bonn/bonn.h"
#include "session/session.h"

struct export_bonn_result {
    int n_views, n_lights, width, height;
    /* RMS error of FMF or DFMF relative to the RMS of the BTF; 0 for BDI, which only rounds to half
     * floats */
    double error;
};

/* Exports the BTF as a ".btf" of Bonn (bonn.h). FMF and DFMF have n_components components, at most
 * LPCA_MAX_COMPONENTS (lpca.h), in addition to the mean. BDI needs the memory of two views. FMF and
 * DFMF need the memory of the whole BTF. The progress stage of BDI is "export". The progress stages
 * of FMF and DFMF are "read" and the stages of lpca.h. */
gboolean export_bonn(const char *session, const char *file, enum bonn_kind kind, int n_components,
                     const struct work *work, struct export_bonn_result *ret, GError **error);
