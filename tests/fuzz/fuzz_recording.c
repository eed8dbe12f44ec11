/* A recording of somebody else, and the requests of its buses, sent in its order. */
#include "fuzz.h"

#include "virtual/replay/steps.h"

static void feed(const Recorded *recorded, int bus) {
    const struct replay_protocol *protocol =
        replay_protocol_find(recorded->kinds->pdata[bus - 1], recorded->sections);
    if (!protocol)
        return;
    struct steps *steps = steps_new(recorded, bus, protocol);
    for (guint i = 0; i < recorded->lines->len; i++) {
        const struct recorded_line *line = recorded->lines->pdata[i];
        g_autoptr(GPtrArray) answers =
            g_ptr_array_new_with_free_func((GDestroyNotify)g_bytes_unref);
        gsize n;
        if (line->bus != bus || line->way == '-')
            continue;
        const guint8 *bytes = g_bytes_get_data(line->bytes, &n);
        steps_take(steps, bytes, n, answers);
    }
    g_autofree char *missing = steps_missing(steps);
    steps_free(steps);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    GError *error = NULL;
    g_autofree char *text = fuzz_text(data, size);
    g_autoptr(Recorded) recorded = recorded_parse(text, "fuzz", &error);
    const gboolean read = recorded != NULL;
    fuzz_check(read, &error);
    for (guint i = 0; read && i < recorded->kinds->len; i++)
        feed(recorded, (int)i + 1);
    return 0;
}
