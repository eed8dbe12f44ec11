/* A checkpoint stores the state of a long computation in a file next to its result. A computation
 * that was cancelled or killed continues from the checkpoint. The state is restored bit for bit.
 *
 * The file is one EXR. The part "checkpoint" is 1 × 1 with the channel "BITS". Its attributes are
 * mesorig.kind = "checkpoint" and mesorig.inputs, a hash of everything that the result depends on.
 * Each array is one more part with the channel "BITS", float. A pixel holds four bytes of the
 * array, whose value as a float has no meaning. The part of an array has two attributes:
 * mesorig.bytes (string), the number of bytes, and mesorig.hash, the XXH3 of the bytes (64 bits,
 * hexadecimal).
 *
 * A checkpoint belongs to the thread that computes. checkpoint_keep() says what other threads may
 * do at the same time. */
#pragma once

#include <glib.h>

typedef struct Checkpoint Checkpoint;

/* Creates a checkpoint for this file. The file is not read yet. */
Checkpoint *checkpoint_new(const char *path);
void checkpoint_free(Checkpoint *checkpoint); /* The file stays. NULL is ignored. */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Checkpoint, checkpoint_free)

/* For tests: sets the time between two saves. The default is 20 s. 0 means that a save is always
 * due. */
void checkpoint_set_period(Checkpoint *checkpoint, double seconds);

/* Reads the arrays of the file. If the file does not exist, is damaged or was written with other
 * inputs, the computation starts from the beginning. checkpoint_note() gives a message about a file
 * that exists. inputs is a text, such as a hash, that covers everything the result depends on. Only
 * the first call has an effect. The inputs of an outer function therefore replace the inputs of the
 * functions that it calls. */
void checkpoint_begin(Checkpoint *checkpoint, const char *inputs);
gboolean checkpoint_is_begun(const Checkpoint *checkpoint);

/* Returns a message for the user: either that the work continues from the checkpoint, or why an
 * existing file cannot be used. Returns NULL if there was no file. */
const char *checkpoint_note(const Checkpoint *checkpoint);

/* Returns an array from the file, or NULL if the file has no array of that name and size. The
 * caller copies the array, because it is freed when another array is kept under that name. */
gconstpointer checkpoint_get(const Checkpoint *checkpoint, const char *name, gsize size);

/* Registers an array to be saved under a name, and replaces an earlier array of that name. The
 * array is borrowed. While threads write to the array, the flags of checkpoint_keep_flags() say
 * which of its values are valid. Each flag is 0 or 1, and a thread sets it with g_atomic_int_set()
 * after it has written the values. A save copies the flags before it copies any array. */
void checkpoint_keep(Checkpoint *checkpoint, const char *name, gconstpointer values, gsize size);
void checkpoint_keep_flags(Checkpoint *checkpoint, const char *name, const int *flags, int n);
/* Removes an array from the arrays to be saved. NULL removes all arrays. */
void checkpoint_drop(Checkpoint *checkpoint, const char *name);

/* Writes the file. checkpoint_save() writes at once. checkpoint_save_if_due() writes only if the
 * last save was long enough ago: at least the period of checkpoint_set_period(), and more than
 * twenty times the duration of the last save.
 *
 * Nothing is written before checkpoint_begin(), or if no array is registered. Failures are ignored,
 * because the computation can continue without a checkpoint. */
void checkpoint_save(Checkpoint *checkpoint);
void checkpoint_save_if_due(Checkpoint *checkpoint);

/* Deletes the file. To be called when the result is on disk. */
void checkpoint_remove(Checkpoint *checkpoint);

/* Deletes the file if it belongs to this computation. To be called after an error, but not after
 * cancelling. */
void checkpoint_discard(Checkpoint *checkpoint);
