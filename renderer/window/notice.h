/* Shows a sentence to a user who has started a program without a terminal. */
#pragma once

/* Asks the desktop's notification service (org.freedesktop.Notifications on the session bus) to
 * show a notice. Returns when the service has answered, after some seconds at most. Without such a
 * service, nothing happens. */
void notice_show(const char *title, const char *sentence);
