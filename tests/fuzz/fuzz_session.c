/* Session files. */
#include "fuzz.h"

#include "plan/plan.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autofree char *text = fuzz_text(data, size);
    struct session_conf conf = {0};
    GError *error = NULL;
    fuzz_check(session_conf_parse(&conf, text, "fuzz", &error), &error);
    session_conf_clear(&conf);
    return 0;
}
