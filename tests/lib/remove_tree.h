/* Removes a file or folder that a test or a benchmark has made, with everything in it. Links are
 * removed, and not the files to which they point. */
#pragma once

void remove_tree(const char *path);
