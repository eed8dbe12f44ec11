/* Shows a sentence to a user who has started a program without a terminal. */
#pragma once

/* Asks the desktop's notification service (org.freedesktop.Notifications on the session bus) to
 * show a notice. Waits for the answer of the service, but at most some seconds. Does nothing if
 * there is no such service. */
void notice_show(const char *title, const char *sentence);
