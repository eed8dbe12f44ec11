#include "capture_session.h"

#include <math.h>

/* Reads the session file, the shots and the calibration from the session directory. Errors contain
 * the path of the directory. */
static gboolean read_texts(struct capture_session *session, GError **error) {
    const char *path = session_path(session->store);
    g_autofree char *text = session_text(session->store, "session.conf", error);
    if (!text || !session_conf_parse(&session->conf, text, path, error) ||
        !(session->shots = session_shots(session->store, error)))
        return FALSE;
    g_autofree char *calibration = session_text(session->store, "calibration.conf", error);
    return calibration &&
           (session->calibration = calibration_from_text(calibration, path, error)) != NULL;
}

static gboolean open_adaptive(struct capture_session *session, const struct adaptive_hooks *hooks,
                              GError **error) {
    const struct adaptive_setup setup = {.session = session->store,
                                         .conf = &session->conf,
                                         .shots = session->shots,
                                         .nominal = &session->devices->geometry,
                                         .timing = &session->devices->timing,
                                         .calibration = session->calibration,
                                         .clock = session->devices->clock,
                                         .hooks = *hooks};
    if (!adaptive_is_wanted(&session->conf))
        return TRUE;
    session->adaptive = adaptive_new(&setup, error);
    return session->adaptive != NULL;
}

gboolean capture_session_open(struct capture_session *session, struct devices *devices,
                              const char *directory, const struct adaptive_hooks *hooks,
                              GError **error) {
    session->devices = devices;
    session->clock = (struct run_clock){.clock = devices->clock, .since_us = -1};
    session->store = session_open(directory, SESSION_CAPTURE, error);
    if (!session->store || !read_texts(session, error) || !open_adaptive(session, hooks, error) ||
        !capture_session_load(session, "clock_s", &session->clock.base_s, error))
        return FALSE;
    capture_session_count(session);
    return TRUE;
}

void capture_session_close(struct capture_session *session) {
    if (!session->store)
        return;
    adaptive_free(session->adaptive);
    session_close(session->store);
    calibration_free(session->calibration);
    g_clear_pointer(&session->shots, g_ptr_array_unref);
    session_conf_clear(&session->conf);
}

void capture_session_count(struct capture_session *session) {
    session->n_shots = session->n_done = 0;
    for (guint i = 0; i < session->shots->len; i++) {
        const struct session_shot *shot = session->shots->pdata[i];
        session->n_shots += shot->state != SHOT_SKIPPED && capture_session_is_chosen(session, shot);
        session->n_done += shot->state == SHOT_DONE;
    }
}

gboolean capture_session_is_chosen(const struct capture_session *session,
                                   const struct session_shot *shot) {
    return !session->adaptive || adaptive_is_chosen(session->adaptive, shot);
}

double capture_session_now_s(const struct capture_session *session) {
    return run_clock_now_s(&session->clock);
}

void capture_session_add_event(const struct capture_session *session, const char *level,
                               const char *source, const char *message) {
    session_add_event(session->store, capture_session_now_s(session), level, source, message, NULL);
    if (session->event)
        session->event(level, source, message, session->event_data);
}

gboolean capture_session_load(const struct capture_session *session, const char *key, double *ret,
                              GError **error) {
    g_autofree char *text = NULL;
    const gboolean ok = session_read_value(session->store, key, &text, error);
    const double value = text ? g_ascii_strtod(text, NULL) : 0;
    *ret = isfinite(value) ? value : 0;
    return ok;
}

void capture_session_save(Session *store, const char *key, double value) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    session_set_value(store, key, g_ascii_dtostr(text, sizeof text, value), NULL);
}
