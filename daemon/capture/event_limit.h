/* Limits the rate of one kind of event of one camera. The limits belong to the Capture. Main loop's
 * thread. */
#pragma once

#include "capture_session.h"

struct event_limit {
    gboolean reported;
    double reported_s; /* on the session's clock */
    int suppressed;
};

/* Adds a warning, or counts it if the last one was added less than a minute ago. */
void event_limit_warn(struct event_limit *limit, const struct capture_session *session,
                      const char *source, const char *message);

/* Reports how many frames were counted since, "3 more frames were " and what, and begins again. */
void event_limit_flush(struct event_limit *limit, const struct capture_session *session,
                       const char *source, const char *what);
