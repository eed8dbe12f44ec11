/* An unnamed temporary file (O_TMPFILE) for values that do not fit into memory. The file system
 * removes the file when it is closed or when the process ends. Several threads may read and write
 * different places. */
#pragma once

#include <glib.h>

typedef struct ScratchFile ScratchFile;

/* Makes a file of this size in the folder, or in the directory of temporary files if it cannot be
 * made in the folder. The space is reserved now, so that a full disk is reported here. content says
 * for error messages what the file contains: "the values of the BTF". The string is not copied and
 * must remain valid. */
ScratchFile *scratch_file_new(const char *folder, guint64 bytes, const char *content,
                              GError **error);
void scratch_file_free(ScratchFile *file); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ScratchFile, scratch_file_free)

/* Read and write n bytes. `at` is the offset of the first byte in the file. */
gboolean scratch_file_read(const ScratchFile *file, guint64 at, gpointer ret, gsize n,
                           GError **error);
gboolean scratch_file_write(const ScratchFile *file, guint64 at, gconstpointer bytes, gsize n,
                            GError **error);
