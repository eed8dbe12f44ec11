/* Limits how often one kind of event of one camera is added. The Capture owns the limits. All
 * functions belong to the main loop's thread. */
#pragma once

#include "capture_session.h"

struct event_limit {
    gboolean reported;
    double reported_s; /* time of the last event on the session's clock */
    int suppressed;
};

/* Adds a warning as an event. If the last event was less than a minute ago, the warning is only
 * counted. The text of the next event then says how many warnings were only counted. */
void event_limit_warn(struct event_limit *limit, const struct capture_session *session,
                      const char *source, const char *message);

/* If warnings were only counted since the last event, adds an event with their number. The text of
 * the event is "3 more frames were " or "1 more frame was ", followed by the string `what`. Resets
 * the limit, even if no event is added. */
void event_limit_flush(struct event_limit *limit, const struct capture_session *session,
                       const char *source, const char *what);
