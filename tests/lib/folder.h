/* The temporary folder of a test program. */
#pragma once

extern char *folder;

void folder_make(void);   /* called in BEFORE_TESTS */
void folder_remove(void); /* called in AFTER_TESTS: removes the folder with everything in it */

char *in_folder(const char *name); /* path of a file in the folder; g_free() */
