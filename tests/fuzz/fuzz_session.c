/* Session files. */
#include "fuzz.h"

#include "plan/plan.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_autofree char *text = fuzz_text(data, size);
    struct session_conf conf = {0};
    GError *error = NULL;
    const gboolean ok = session_conf_parse(&conf, text, "fuzz", &error);
    fuzz_check(ok, error);
    session_conf_clear(&conf);
    return 0;
}
