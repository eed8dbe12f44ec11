/* Checkpoints of computations on a BTF. Any thread. */
#pragma once

#include "btf_matrix.h"
#include "exr/checkpoint.h"

/* As checkpoint_begin(); inputs are a hash of the BTF's values, directions and shape, of what
 * (anything in words that the result depends on beside the BTF) and of this program's version. */
void btf_checkpoint_begin(Checkpoint *checkpoint, const struct btf_matrix *btf, const char *what);
