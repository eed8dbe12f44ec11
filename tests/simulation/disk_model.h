/*
 * The contents of the medium of a simulated disk, computed from the journal of calls (disk.h).
 * POSIX promises only this: the contents of a file are on the medium after fsync() of the file, and
 * its name after fsync() of the folder. When the power fails,
 *
 *   - each write and each change of length since the last fsync() of a file is kept, lost, or torn
 *     at a multiple of 512 bytes; what fsync() has failed to write is lost even if a later one
 *     succeeds, since the kernel holds the pages to be clean;
 *   - of the changes of a folder since its last fsync(), the first few are kept. A renaming is one
 *     change.
 *
 * This is weaker than what ext4 and XFS do by default. Memory that SQLite maps (session.db-shm) is
 * made again from the write-ahead log, and is lost.
 */
#pragma once

#include "disk.h"

typedef struct DiskModel DiskModel;

/* What lies in the folder is on the medium. */
DiskModel *disk_model_new(const char *root);
void disk_model_free(DiskModel *model); /* NULL is ignored */

/* Takes in the journal, and empties it. */
void disk_model_read(DiskModel *model, struct disk *disk);

/* NULL if the folder holds what the journal says, so that no call was missed; else what differs.
 * g_free() */
char *disk_model_check(DiskModel *model);

/* Replaces the folder's contents by what is left of them after a power cut, which then is on the
 * medium. misplaces: a write of a picture that was synced lies 512 bytes further on in its file,
 * whose name is returned. NULL: none, or there was no such write. g_free() */
char *disk_model_cut(DiskModel *model, enum cut_mode mode, gboolean misplaces, GRand *random);

/* One bit of a file flips, on the medium and in the folder; path is relative to it. */
void disk_model_rot(DiskModel *model, const char *path, GRand *random);

void disk_remove_tree(const char *path);
