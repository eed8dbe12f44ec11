/* hooks.conf, which says who is told about which events. */
#include "fuzz.h"

#include "hooks/hooks_conf.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    g_auto(HooksConf) conf = {0};
    GError *error = NULL;
    fuzz_check(hooks_conf_load(&conf, fuzz_file(data, size), &error), &error);
    return 0;
}
