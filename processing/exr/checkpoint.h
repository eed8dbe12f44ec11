/*
 * What a long computation has done so far, kept in a file beside its result, so that the same
 * computation goes on from there after it was cancelled or killed. What it goes on with is what it
 * had, to the last bit.
 *
 * On disk, one EXR: part "checkpoint" (1 × 1, channel "BITS"; mesorig.kind = "checkpoint",
 * mesorig.inputs: a hash of what the result depends on), and a part for each array: channel "BITS",
 * float, four bytes a pixel, not numbers; mesorig.bytes of them are it (string), mesorig.hash
 * is their XXH3 (64 bits, hexadecimal).
 *
 * Belongs to the thread that computes; what other threads do meanwhile is said at
 * checkpoint_keep().
 */
#pragma once

#include <gio/gio.h>

typedef struct Checkpoint Checkpoint;

/* Reads nothing yet. */
Checkpoint *checkpoint_new(const char *path);
void checkpoint_free(Checkpoint *checkpoint); /* NULL is ignored; the file stays */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Checkpoint, checkpoint_free)

/* How long work may last that is not kept: 20 s if this is not called. */
void checkpoint_set_period(Checkpoint *checkpoint, double seconds);

/* Reads the file, if there is one of these inputs: a text, such as a hash, of all that the result
 * depends on. Only the first call counts: who calls others says all that they depend on. */
void checkpoint_begin(Checkpoint *checkpoint, const char *inputs);
gboolean checkpoint_is_begun(const Checkpoint *checkpoint);

/* For people: that work goes on, or why a file that is there is of no use. NULL: there is none. */
const char *checkpoint_note(const Checkpoint *checkpoint);

/* An array that was kept when the work was cut off; NULL if there is none of that name and size.
 * It is the caller's to copy, and gone once something is kept under that name. */
gconstpointer checkpoint_get(const Checkpoint *checkpoint, const char *name, gsize size);

/* From now on values, borrowed, are what is kept under that name, or nothing is. Of an array that
 * threads write meanwhile what counts is what flags say, which are copied before all arrays: each 0
 * or 1, set by g_atomic_int_set() after what it stands for is written. */
void checkpoint_keep(Checkpoint *checkpoint, const char *name, gconstpointer values, gsize size);
void checkpoint_keep_flags(Checkpoint *checkpoint, const char *name, const int *flags, int n);
void checkpoint_drop(Checkpoint *checkpoint, const char *name); /* NULL: all */

/* Writes the file: always, or if that is due. Work that cannot be kept is no reason to stop it. */
void checkpoint_save(Checkpoint *checkpoint);
void checkpoint_save_if_due(Checkpoint *checkpoint);

/* Once the result is safe. */
void checkpoint_remove(Checkpoint *checkpoint);

/* Once the work has failed for good: a file of other work stays. */
void checkpoint_discard(Checkpoint *checkpoint);
