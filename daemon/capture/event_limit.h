/* Limits the rate of one kind of event of one camera. The limits belong to the Capture. Main loop's
 * thread. */
#pragma once

#include "capture_session.h"

struct event_limit {
    gboolean reported;
    double reported_s; /* on the session's clock */
    int suppressed;
};

/* Adds a warning as an event, together with the number of warnings that were counted before. If the
 * last warning was added less than a minute ago, only counts this one. */
void event_limit_warn(struct event_limit *limit, const struct capture_session *session,
                      const char *source, const char *message);

/* If warnings were counted since the last event, adds an event with their number: "3 more frames
 * were " followed by what. Then starts again. */
void event_limit_flush(struct event_limit *limit, const struct capture_session *session,
                       const char *source, const char *what);
