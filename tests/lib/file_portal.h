/* The desktop's portal for files (org.freedesktop.portal.FileChooser) on a private bus. It also
 * acts as the user who answers its dialogs, and as the desktop's notification service. */
#pragma once

#include <glib.h>

typedef struct FilePortal FilePortal;

FilePortal *file_portal_new(void); /* returns when the portal is on the bus */
void file_portal_free(FilePortal *portal);
const char *file_portal_bus(const FilePortal *portal); /* address */

/* Sets the answer to all following dialogs. With path NULL, the user cancels. */
void file_portal_answer(FilePortal *portal, const char *path);

/* Waits for the n-th dialog or notice, and returns the last one with its parameter, for example
 * "OpenFile directory", "SaveFile weave-001.png" or "Notify sentence"; g_free(). */
char *file_portal_wait(FilePortal *portal, int n);
