#include "run_totals.h"

#include <sys/resource.h>

#define SAVE_INTERVAL_S 10

gboolean run_totals_load(struct run_totals *totals, const struct capture_session *session,
                         GError **error) {
    totals->begun_us = g_get_monotonic_time();
    return capture_session_load(session, "real_s", &totals->real_base_s, error) &&
           capture_session_load(session, "frames", &totals->frames_base, error) &&
           capture_session_load(session, "retakes", &totals->retakes_base, error) &&
           exposure_advice_load(&totals->exposures, session->store, error);
}

void run_totals_save(struct run_totals *totals, const struct capture_session *session) {
    const double real_s = (double)(g_get_monotonic_time() - totals->begun_us) * 1e-6;
    Session *store = session->store;
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    totals->saved_s = capture_session_now_s(session);
    capture_session_save(store, "clock_s", totals->saved_s);
    capture_session_save(store, "real_s", totals->real_base_s + real_s);
    capture_session_save(store, "frames", totals->frames_base + (double)totals->frames);
    capture_session_save(store, "retakes", totals->retakes_base + (double)totals->retakes);
    exposure_advice_save(&totals->exposures, store);
    capture_session_save(store, "capture_peak_memory_mib", (double)usage.ru_maxrss / 1024);
}

void run_totals_save_if_due(struct run_totals *totals, const struct capture_session *session) {
    if (capture_session_now_s(session) > totals->saved_s + SAVE_INTERVAL_S)
        run_totals_save(totals, session);
}
