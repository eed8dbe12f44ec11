/*
 * What a long computation has done so far, kept in a file beside its result, so that the same
 * computation goes on from there after it was cancelled or killed. What it goes on with is what it
 * had, to the last bit.
 *
 * On disk, one EXR: part "unfinished" (1 × 1, channel "BITS"; mesorig.kind = "unfinished",
 * mesorig.inputs: a hash of what the result depends on), and a part for each array: channel "BITS",
 * float, four bytes a pixel, not numbers; mesorig.bytes of them are it (string), mesorig.hash
 * is their XXH3 (64 bits, hexadecimal).
 *
 * Belongs to the thread that computes; what other threads do meanwhile is said at
 * unfinished_keep().
 */
#pragma once

#include "btf_matrix.h"

#include <gio/gio.h>

typedef struct Unfinished Unfinished;

/* Reads nothing yet. */
Unfinished *unfinished_new(const char *path);
void unfinished_free(Unfinished *unfinished); /* NULL is ignored; the file stays */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Unfinished, unfinished_free)

/* How long work may last that is not kept: 20 s if this is not called. */
void unfinished_set_period(Unfinished *unfinished, double seconds);

/* Reads the file, if there is one of this BTF and of what (anything in words that the result
 * depends on beside it). Only the first call counts: who calls others says all that they depend on.
 */
void unfinished_begin(Unfinished *unfinished, const struct btf_matrix *btf, const char *what);

/* For people: that work goes on, or why a file that is there is of no use. NULL: there is none. */
const char *unfinished_note(const Unfinished *unfinished);

/* An array that was kept when the work was cut off; NULL if there is none of that name and size.
 * It is the caller's to copy, and gone once something is kept under that name. */
gconstpointer unfinished_get(const Unfinished *unfinished, const char *name, gsize size);

/* From now on values, borrowed, are what is kept under that name, or nothing is. Of an array that
 * threads write meanwhile what counts is what flags say, which are copied before all arrays: each 0
 * or 1, set by g_atomic_int_set() after what it stands for is written. */
void unfinished_keep(Unfinished *unfinished, const char *name, gconstpointer values, gsize size);
void unfinished_keep_flags(Unfinished *unfinished, const char *name, const int *flags, int n);
void unfinished_drop(Unfinished *unfinished, const char *name); /* NULL: all */

/* Writes the file: always, or if that is due. Work that cannot be kept is no reason to stop it. */
void unfinished_save(Unfinished *unfinished);
void unfinished_save_if_due(Unfinished *unfinished);

/* Once the result is safe. */
void unfinished_remove(Unfinished *unfinished);

/* Once the work has failed for good: a file of other work stays. */
void unfinished_discard(Unfinished *unfinished);
