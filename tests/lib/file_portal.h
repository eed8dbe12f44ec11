/* The desktop's portal for files (org.freedesktop.portal.FileChooser) on a bus of its own, and a
 * user who answers its dialogs at the same time; and its service for notices. */
#pragma once

#include <glib.h>

typedef struct FilePortal FilePortal;

FilePortal *file_portal_new(void); /* the portal is on the bus when it returns */
void file_portal_free(FilePortal *portal);
const char *file_portal_bus(const FilePortal *portal); /* address */

/* The answer to dialogs from now on. path NULL: the user cancels. */
void file_portal_answer(FilePortal *portal, const char *path);

/* The last dialog or notice, and what it was asked for: "OpenFile directory", "SaveFile
 * weave-001.png", "Notify sentence"; waits for the n-th, g_free(). */
char *file_portal_wait(FilePortal *portal, int n);
