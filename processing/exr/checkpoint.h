/*
 * A checkpoint: the state of a long computation in a file beside its result, so that it continues
 * after it was cancelled or killed. The state is restored bit for bit.
 *
 * The file is one EXR: a part "checkpoint" (1 × 1, channel "BITS"; mesorig.kind = "checkpoint",
 * mesorig.inputs: a hash of what the result depends on), and one part per array: channel "BITS",
 * float, four bytes per pixel that are not numbers; mesorig.bytes (string) is their number,
 * mesorig.hash their XXH3 (64 bits, hexadecimal).
 *
 * Belongs to the thread that computes; checkpoint_keep() says what other threads may do
 * meanwhile.
 */
#pragma once

#include <gio/gio.h>

typedef struct Checkpoint Checkpoint;

/* Does not read the file yet. */
Checkpoint *checkpoint_new(const char *path);
void checkpoint_free(Checkpoint *checkpoint); /* NULL is ignored; the file stays */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Checkpoint, checkpoint_free)

/* Sets the period between saves; the default is 20 s. */
void checkpoint_set_period(Checkpoint *checkpoint, double seconds);

/* Reads the file if it has the same inputs: a text, such as a hash, of all that the result
 * depends on. Only the first call counts: an outer function describes the inputs of those that it
 * calls.
 */
void checkpoint_begin(Checkpoint *checkpoint, const char *inputs);
gboolean checkpoint_is_begun(const Checkpoint *checkpoint);

/* A message for the user: the work continues, or why an existing file cannot be used. NULL: there
 * is none. */
const char *checkpoint_note(const Checkpoint *checkpoint);

/* An array from the file; NULL if there is none of that name and size. The caller copies it; it
 * is freed once something is kept under that name. */
gconstpointer checkpoint_get(const Checkpoint *checkpoint, const char *name, gsize size);

/* Registers an array, borrowed, to be saved under a name; replaces an earlier one. For arrays
 * that threads are writing, the flags of checkpoint_keep_flags() say what is valid: they are
 * copied before all arrays; each is 0 or 1, set by g_atomic_int_set() after its values are
 * written. */
void checkpoint_keep(Checkpoint *checkpoint, const char *name, gconstpointer values, gsize size);
void checkpoint_keep_flags(Checkpoint *checkpoint, const char *name, const int *flags, int n);
void checkpoint_drop(Checkpoint *checkpoint, const char *name); /* NULL: all */

/* Writes the file: always, or if the period has passed. Failures are ignored: they are no reason
 * to stop the computation. */
void checkpoint_save(Checkpoint *checkpoint);
void checkpoint_save_if_due(Checkpoint *checkpoint);

/* Deletes the file, once the result is on disk. */
void checkpoint_remove(Checkpoint *checkpoint);

/* Deletes the file after an error; a file of another computation stays. */
void checkpoint_discard(Checkpoint *checkpoint);
