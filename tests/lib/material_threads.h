/* Many threads that evaluate one material at the same time. This is plain C, so that it can be
 * built without the other files. */
#pragma once

/* Opens the material, with the MDF unless mdf is NULL. n threads, at most 16, evaluate the same
 * points in different orders. Returns NULL on success, otherwise a description of the failure: a
 * result may differ from the result of a single thread. */
const char *material_threads_ask(const char *path, const char *mdf, int n);
