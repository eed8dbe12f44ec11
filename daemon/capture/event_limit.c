#include "event_limit.h"

#define INTERVAL_S 60

void event_limit_warn(struct event_limit *limit, const struct capture_session *session,
                      const char *source, const char *message) {
    const double now_s = capture_session_now_s(session);
    if (limit->reported && now_s < limit->reported_s + INTERVAL_S) {
        limit->suppressed++;
        return;
    }
    g_autofree char *text =
        limit->suppressed == 0
            ? g_strdup(message)
            : g_strdup_printf("%s (and %d more since the last report)", message, limit->suppressed);
    *limit = (struct event_limit){.reported = TRUE, .reported_s = now_s};
    capture_session_add_event(session, "warning", source, text);
}

void event_limit_flush(struct event_limit *limit, const struct capture_session *session,
                       const char *source, const char *what) {
    if (limit->suppressed > 0) {
        g_autofree char *text =
            limit->suppressed == 1
                ? g_strdup_printf("1 more frame was %s", what)
                : g_strdup_printf("%d more frames were %s", limit->suppressed, what);
        capture_session_add_event(session, "warning", source, text);
    }
    *limit = (struct event_limit){0};
}
