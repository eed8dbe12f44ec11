/* A sentence for a user who has started a program without a terminal. */
#pragma once

/* Asks the desktop's notification service (org.freedesktop.Notifications on the session bus) to
 * show it, and returns when that has, or after seconds at most. Where there is no service, nothing
 * happens. */
void notice_show(const char *title, const char *sentence);
