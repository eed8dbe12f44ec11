/* Many threads that ask one material at the same time; plain C, so that it can be built without the
 * rest. */
#pragma once

/* Opens the material (mdf: NULL: none) and lets n threads, at most 16, ask the same questions in
 * different orders. NULL, or what went wrong: an answer differs from that of one thread only. */
const char *material_threads_ask(const char *path, const char *mdf, int n);
