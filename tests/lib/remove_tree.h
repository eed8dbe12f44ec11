/* Removes a file or folder that a test or a benchmark has made, with everything in it. Links are
 * removed, and not the files to which they point. */
#pragma once

void remove_tree(const char *path);

/* Declares char *name, the path of a new temporary folder. The folder is removed with everything in
 * it at the end of the scope. */
#define TEMPORARY_FOLDER(name)                                                                     \
    __attribute__((cleanup(remove_tree_end))) char *name = remove_tree_begin()

char *remove_tree_begin(void); /* called by the macro */
void remove_tree_end(char **path);
