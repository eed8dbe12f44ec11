/* Checkpoints of computations on a BTF. Any thread. */
#pragma once

#include "btf_matrix.h"
#include "exr/checkpoint.h"

/* Calls checkpoint_begin() with a hash of the BTF's values, directions and shape, of the program's
 * version, and of the text `what`. This text describes everything else on which the result depends.
 * Does nothing if the checkpoint has begun already. */
void btf_checkpoint_begin(Checkpoint *checkpoint, const struct btf_matrix *btf, const char *what);
