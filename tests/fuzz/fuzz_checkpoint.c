/* Checkpoints of computations that were interrupted. */
#include "fuzz.h"

#include "exr/checkpoint.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const gsize sizes[] = {0, 1, 4, 48, 4096};
    static volatile guint sum;
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(fuzz_file(data, size));
    checkpoint_begin(checkpoint, FUZZ_CHECKPOINT_INPUTS);
    g_assert_true(checkpoint_is_begun(checkpoint));
    checkpoint_note(checkpoint);
    for (gsize i = 0; i < G_N_ELEMENTS(sizes); i++) {
        const guint8 *values = checkpoint_get(checkpoint, "weights", sizes[i]);
        for (gsize k = 0; values && k < sizes[i]; k++) /* all of it is there */
            sum += values[k];
        checkpoint_get(checkpoint, "done", sizes[i]);
    }
    return 0;
}
