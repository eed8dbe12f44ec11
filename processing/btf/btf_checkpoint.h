/* Checkpoints of computations on a BTF. Any thread. */
#pragma once

#include "btf_matrix.h"
#include "exr/checkpoint.h"

/* Calls checkpoint_begin() with a hash of the BTF's values, directions and shape, of `what` (a
 * text with everything else that the result depends on), and of the program's version. */
void btf_checkpoint_begin(Checkpoint *checkpoint, const struct btf_matrix *btf, const char *what);
